#include "raysfm/camera/stretch.h"

namespace raysfm {

bool stretch(double factor, Camera* camera) {
  const auto stretched = [&](auto& model) {
    if constexpr (requires { model.fx, model.cx; }) {
      model.fx *= factor;
      model.cx = (model.cx + 0.5) * factor - 0.5;
      return true;
    } else {
      return false;
    }
  };
  return std::visit(stretched, camera->model);
}

}  // namespace raysfm
