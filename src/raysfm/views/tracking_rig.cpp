#include "raysfm/views/tracking_rig.h"

#include <fmt/format.h>

#include <algorithm>

#include "raysfm/camera/camera_class.h"

namespace raysfm {
namespace {

// Share of the pixels of `from` whose rays, followed to a point far away, `to` sees.
double common_share(const TrackingRig& rig, int from, int to) {
  constexpr int kGrid = 16;
  constexpr double kFar = 20;  // baselines
  const Camera& camera = rig.camera(from);
  const Rigid3 to_from_from = rig.cam_from_rig(to) * camera.rig_from_cam;
  const double distance = kFar * to_from_from.translation.norm();
  int rays = 0, seen = 0;
  for (int i = 0; i < kGrid * kGrid; ++i) {
    const Eigen::Vector2d pixel((i % kGrid + 0.5) * camera.width / kGrid,
                                (i / kGrid + 0.5) * camera.height / kGrid);
    Ray ray;
    Eigen::Vector2d other;
    if (!camera.ray(pixel, &ray)) continue;
    ++rays;
    seen += rig.see(to, to_from_from * Eigen::Vector3d(ray.origin + distance * ray.direction), &other);
  }
  return rays > 0 ? static_cast<double>(seen) / rays : 0;
}

}  // namespace

TrackingRig::TrackingRig(Rig rig, ErrorMeasure measure) : rig_(std::move(rig)) {
  constexpr double kLeastCommonShare = 0.05;
  central_ = camera_class(rig_) == CameraClass::kCentral;
  weighted_ = measure != ErrorMeasure::kAngularPlain && measure != ErrorMeasure::kPaper;
  angular_ = measure == ErrorMeasure::kAngular || measure == ErrorMeasure::kAngularPlain;
  for (const Camera& camera : rig_.cameras) {
    angular_ |= !camera.can_project();
    scans_ |= camera.shutter.readout > 0;
    cam_from_rig_.push_back(camera.rig_from_cam.inverse());
    pixels_per_radian_.push_back(camera.pixels_per_radian());
    finders_.emplace_back(camera);
  }
  for (int a = 0; a < size(); ++a) {
    for (int b = 0; b < size(); ++b) {
      if (a == b || (cam_from_rig(b) * camera(a).rig_from_cam).translation.norm() < 1e-9) continue;
      if (common_share(*this, a, b) > kLeastCommonShare) common_views_.push_back({a, b});
    }
  }
}

double TrackingRig::pixels_per_radian() const {
  return *std::min_element(pixels_per_radian_.begin(), pixels_per_radian_.end());
}

bool TrackingRig::observe(int c, const Eigen::Vector2f& pixel, ObservedRay* ray) const {
  const Camera& camera = rig_.cameras[c];
  const AngularWeight weight = weighted_ ? AngularWeight::kPixel : AngularWeight::kNone;
  if (!observe_ray(camera, pixel.cast<double>(), weight, ray)) return false;
  if (!weighted_) ray->tangents *= pixels_per_radian_[c];
  return true;
}

Result<void> validate_error(const Rig& rig, ErrorMeasure measure) {
  if (measure != ErrorMeasure::kPixel) return {};
  for (const Camera& camera : rig.cameras) {
    if (camera.can_project()) continue;
    return bad_input(fmt::format("--error pixel: a camera of model {} cannot project; use angular or auto",
                                 model_name(camera.model)));
  }
  return {};
}

}  // namespace raysfm
