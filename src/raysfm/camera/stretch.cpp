#include "raysfm/camera/stretch.h"

namespace raysfm {

bool stretch(const Eigen::Vector2d& factors, Camera* camera) {
  const auto stretched = [&](auto& model) {
    if constexpr (requires { model.fx, model.fy; }) {
      model.fx *= factors.x();
      model.fy *= factors.y();
      model.cx = (model.cx + 0.5) * factors.x() - 0.5;
      model.cy = (model.cy + 0.5) * factors.y() - 0.5;
      return true;
    } else {
      return false;
    }
  };
  return std::visit(stretched, camera->model);
}

}  // namespace raysfm
