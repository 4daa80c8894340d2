#include "raysfm/camera/model_check.h"

#include <cmath>

namespace raysfm {
namespace {

constexpr double kLargest = 1e6;  // pixels

template <typename Model>
std::optional<ParameterProblem> problem_of(const Model& model) {
  if constexpr (ParametricModel<Model>) {
    const auto numbers = model.parameters();
    for (size_t i = 0; i < numbers.size(); ++i) {
      const std::string_view name = Model::kParameterNames[i];
      const double value = numbers[i];
      if (!std::isfinite(value)) return ParameterProblem{name, value, "a finite number"};
      if ((name == "fx" || name == "fy") && !(value > 0 && value <= kLargest)) {
        return ParameterProblem{name, value, "above 0, at most 1e6"};
      }
      if ((name == "cx" || name == "cy") && !(std::abs(value) <= kLargest)) {
        return ParameterProblem{name, value, "between -1e6 and 1e6"};
      }
    }
  }
  if constexpr (requires { model.problem(); }) {
    return model.problem();
  } else {
    return std::nullopt;
  }
}

}  // namespace

std::optional<ParameterProblem> find_problem(const CameraModel& model) {
  return std::visit([](const auto& m) { return problem_of(m); }, model);
}

}  // namespace raysfm
