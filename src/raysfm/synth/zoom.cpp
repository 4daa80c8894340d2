#include "raysfm/synth/zoom.h"

#include <algorithm>
#include <cmath>
#include <type_traits>

namespace raysfm::synth {

namespace {

// The parameter of that name in `values`, or null.
template <typename Model, typename Values>
double* find(std::string_view name, Values& values) {
  const auto at = std::find(Model::kParameterNames.begin(), Model::kParameterNames.end(), name);
  return at == Model::kParameterNames.end()
             ? nullptr
             : &values[static_cast<size_t>(at - Model::kParameterNames.begin())];
}

}  // namespace

std::optional<Lens> lens_of(const Camera& camera) {
  return std::visit(
      [](const auto& model) -> std::optional<Lens> {
        using Model = std::decay_t<decltype(model)>;
        if constexpr (!ParametricModel<Model>) {
          return std::nullopt;
        } else {
          auto values = model.parameters();
          const double *fx = find<Model>("fx", values), *fy = find<Model>("fy", values),
                       *cx = find<Model>("cx", values), *cy = find<Model>("cy", values);
          if (!fx || !fy || !cx || !cy) return std::nullopt;
          return Lens{*fx, *fy, *cx, *cy};
        }
      },
      camera.model);
}

Camera with_focal_lengths(Camera camera, double new_fx, double new_fy) {
  camera.model = std::visit(
      [&](const auto& model) -> CameraModel {
        using Model = std::decay_t<decltype(model)>;
        if constexpr (!ParametricModel<Model>) {
          return model;
        } else {
          auto values = model.parameters();
          double *fx = find<Model>("fx", values), *fy = find<Model>("fy", values);
          if (!fx || !fy) return model;
          *fx = new_fx;
          *fy = new_fy;
          return Model::from_parameters(values);
        }
      },
      camera.model);
  return camera;
}

double zoom_factor(double last, double part) {
  return std::pow(last, part * part * part * (10 + part * (6 * part - 15)));
}

}  // namespace raysfm::synth
