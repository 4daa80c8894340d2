#include "raysfm/views/tracking_rig.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <variant>

#include "raysfm/camera/camera_class.h"
#include "raysfm/residuals/block_residual.h"

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

// Residuals of pixels at the origin, of a camera that is the rig, are where points are seen.
void see_by_blocks(const Camera& camera, std::span<const Eigen::Vector3d> points,
                   std::span<PointProjection> seen) {
  static constexpr double kOrigin[kBlockLanes] = {};
  static const Camera kRig;
  const auto see = [&](const BlockResidual& projection) {
    ResidualBlock block;
    for (size_t begin = 0; begin < points.size(); begin += kBlockLanes) {
      const size_t count = std::min<size_t>(kBlockLanes, points.size() - begin);
      for (size_t k = 0; k < kBlockLanes; ++k) {
        for (int i = 0; i < 3; ++i) block.x[i][k] = points[begin + std::min(k, count - 1)][i];
      }
      projection.evaluate(0, true, &block);
      for (size_t k = 0; k < count; ++k) {
        PointProjection& s = seen[begin + k];
        s.pixel = {block.residual[0][k], block.residual[1][k]};
        s.in_image = std::isfinite(block.squared[k]) && camera.contains(s.pixel);
        for (int i = 0; i < 6; ++i) s.jacobian(i / 3, i % 3) = block.jacobian[i][k];
      }
    }
  };
  std::visit([&](const auto& model) { see(PixelResidual(kRig, model, kOrigin, kOrigin)); }, camera.model);
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
    curvatures_.emplace_back(camera);
  }
  for (int a = 0; a < size(); ++a) {
    for (int b = 0; b < size(); ++b) {
      if (a == b || (cam_from_rig(b) * camera(a).rig_from_cam).translation.norm() < 1e-9) continue;
      if (common_share(*this, a, b) > kLeastCommonShare) common_views_.push_back({a, b});
    }
  }
}

void TrackingRig::see(int c, std::span<const Eigen::Vector3d> points_in_cam,
                      std::vector<PointProjection>* seen) const {
  seen->resize(points_in_cam.size());
  if (camera(c).can_project()) {
    see_by_blocks(camera(c), points_in_cam, *seen);
    return;
  }
  for (size_t i = 0; i < points_in_cam.size(); ++i) {
    PointProjection& s = (*seen)[i];
    s.in_image = see(c, points_in_cam[i], &s.pixel, &s.jacobian);
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
