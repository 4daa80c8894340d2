#include "raysfm/robust/stereo_motion.h"

#include "raysfm/geometry/triangulation.h"
#include "raysfm/robust/absolute_pose.h"

namespace raysfm {

using Eigen::Vector2d;
using Eigen::Vector3d;

namespace {

// Depths from less parallax than this many times the error of a ray are left to the refinement.
constexpr double kMinParallax = 5;
// The residual of a point that carries its own error, over that of an exact one.
constexpr double kPointError = 2;

struct StereoPoints {
  std::vector<int> indices;  // in the table
  std::vector<Vector3d> points;
};

StereoPoints triangulate_view0(const RigTable& table, double max_error) {
  StereoPoints result;
  std::vector<Ray> rays;
  for (int k = 0; k < table.size(); ++k) {
    const RigTable::Point& in = table.points[k];
    rays.clear();
    for (int i = in.begin; i < in.end; ++i) {
      if (table.views[i] == 0) rays.push_back(table.ray(i));
    }
    Triangulation point;
    if (rays.size() < 2 || !triangulate(rays, &point)) continue;
    if (point.parallax < kMinParallax * max_error / std::sqrt(in.weight2)) continue;
    bool fits = true;
    for (int i = in.begin; i < in.end && fits; ++i) {
      Vector2d r(0, 0);
      fits = table.views[i] != 0 || (table.rays[i].residual(point.point, &r) && r.norm() <= max_error);
    }
    if (!fits) continue;
    result.indices.push_back(k);
    result.points.push_back(point.point);
  }
  return result;
}

}  // namespace

bool motion_from_stereo_points(const RigTable& table, const GenericStartOptions& options, RigMotion* motion,
                               std::vector<int>* inliers) {
  const StereoPoints stereo = triangulate_view0(table, options.max_error);
  const size_t count = stereo.indices.size();
  if (count < static_cast<size_t>(options.min_inliers)) return false;
  PoseEstimator estimator;
  std::vector<ObservedRay> rays(count);
  std::vector<uint8_t> fits(count, 1);
  const Rig no_rig;
  for (const int view : {1, 2}) {
    for (size_t k = 0; k < count; ++k) rays[k] = table.rays[table.points[stereo.indices[k]].primary[view]];
    PoseEstimate estimate;
    estimator.estimate(no_rig, {stereo.points, {}, {}, rays}, nullptr,
                       {.max_error_px = kPointError * options.max_error,
                        .min_inliers = options.min_inliers,
                        .max_iterations = options.max_iterations,
                        .confidence = options.confidence,
                        .loss = {RobustLoss::Kind::kHuber, options.max_error},
                        .seed = options.seed,
                        .stream = options.stream},
                       &estimate);
    if (!estimate.ok()) return false;
    (view == 1 ? motion->rig1_from_rig0 : motion->rig2_from_rig0) = estimate.rig_from_world;
    for (size_t k = 0; k < count; ++k) fits[k] &= estimate.inlier[k];
  }
  inliers->clear();
  for (size_t k = 0; k < count; ++k) {
    if (fits[k]) inliers->push_back(stereo.indices[k]);
  }
  return inliers->size() >= static_cast<size_t>(options.min_inliers);
}

}  // namespace raysfm
