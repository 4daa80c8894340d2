#include "raysfm/calibration/refined_rig.h"

#include <algorithm>
#include <cmath>
#include <string_view>

#include "raysfm/calibration/rig_parameters.h"

namespace raysfm {
namespace {

using Kind = RigParameters::Kind;

// By how much a number of a camera was refined; of a focal length the logarithm of the factor.
double change_of(std::span<const CalibrationNumber> numbers, int camera, std::string_view name,
                 bool is_factor) {
  const auto n = std::ranges::find_if(
      numbers, [&](const CalibrationNumber& x) { return x.camera == camera && x.name == name; });
  if (n == numbers.end()) return 0;
  return is_factor ? std::log(n->refined / n->given) : n->refined - n->given;
}

}  // namespace

RefinedRig refined_rig(const Rig& refined, std::span<const CalibrationNumber> numbers) {
  const RigParameters parameters(refined);
  Eigen::VectorXd values = Eigen::VectorXd::Zero(parameters.size());
  for (int i = 0; i < parameters.size(); ++i) {
    const RigParameters::Parameter& p = parameters[i];
    if (p.kind == Kind::kReadout) continue;
    const auto of_camera = [&](int camera) {
      const double change = change_of(numbers, camera, parameters.name(i), p.kind <= Kind::kAspect);
      return p.kind == Kind::kAspect ? change - change_of(numbers, camera, "fx", true) : change;
    };
    values[i] = of_camera(p.camera);
    const bool is_shared = p.camera > 0 && p.kind <= Kind::kNumber && parameters.concerns(0, p.camera);
    if (is_shared) values[i] -= of_camera(0);
  }
  return {parameters.rig(-values), values};
}

}  // namespace raysfm
