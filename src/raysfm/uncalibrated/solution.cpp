#include "raysfm/uncalibrated/solution.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "raysfm/projective/absolute_quadric.h"
#include "raysfm/uncalibrated/lens_choice.h"

namespace raysfm {
namespace {

constexpr int kCandidates = 3;

Result<LensAdjustmentSummary> adjust(const PointTracks& tracks, const std::vector<double>& weights,
                                     const LensAdjustmentOptions& options, LensMethod method,
                                     UncalibratedScene* scene) {
  if (!options.lens_of_image.empty()) return adjust_standard(tracks, weights, options, scene);
  switch (method) {
    case LensMethod::kIntrinsicsFree:
      return adjust_intrinsics_free(tracks, weights, options, scene);
    case LensMethod::kStandard:
      return adjust_standard(tracks, weights, options, scene);
    case LensMethod::kPolished:
      break;
  }
  return adjust_polished(tracks, weights, options, scene);
}

LensAdjustmentOptions adjustment_of(const PointTracks& tracks, const SolveOptions& options, bool equal) {
  LensAdjustmentOptions adjustment;
  adjustment.constraints = constraints_for(tracks, options, equal);
  adjustment.method = options.constraints;
  adjustment.with_sigma = false;
  adjustment.threads = options.threads;
  adjustment.lm.progress = &options.go_on;
  return adjustment;
}

}  // namespace

PointTracks Units::apply(const PointTracks& tracks) const {
  PointTracks scaled = tracks;
  for (Eigen::Vector2d& p : scaled.pixel) p = (p - centre) / scale;
  return scaled;
}

Lens Units::undo(const Lens& lens) const {
  return {scale * lens.fx, scale * lens.fy, scale * lens.cx + centre.x(), scale * lens.cy + centre.y(),
          scale * lens.skew};
}

Error interrupted() {
  return no_reconstruction("interrupted");
}

Result<ProjectiveStart> start_of(const PointTracks& tracks, const Units& units, const SolveOptions& options,
                                 int rank) {
  return projective_start(units.apply(tracks), {.max_error = options.max_error_px / units.scale,
                                                .max_samples = options.max_samples,
                                                .seed = options.seed,
                                                .rank = rank,
                                                .progress = &options.go_on});
}

std::vector<UncalibratedScene> metric_starts(const PointTracks& tracks, const Units& units,
                                             const ProjectiveStart& start, bool equal) {
  const std::vector<double> weights(start.inlier.begin(), start.inlier.end());
  const ObservationIndex index = index_observations(tracks, weights, nullptr, kMinPointsPerImage, 2);
  if (index.image_count() < 2) return {};
  ProjectiveScene part;
  for (const int j : index.images) part.views.push_back(start.scene.views[j]);
  for (const int i : index.points) part.points.push_back(start.scene.points[i]);
  std::vector<UncalibratedScene> scenes;
  for (const UncalibratedScene& metric : metric_candidates(part, index, equal, kCandidates)) {
    UncalibratedScene& scene = scenes.emplace_back();
    scene.cam_from_world.resize(tracks.image_count);
    scene.lenses.resize(tracks.image_count);
    scene.points.assign(tracks.point_count, Eigen::Vector3d::Zero());
    for (int j = 0; j < index.image_count(); ++j) {
      scene.cam_from_world[index.images[j]] = metric.cam_from_world[j];
      scene.lenses[index.images[j]] = units.undo(metric.lenses[j]);
    }
    for (int i = 0; i < index.point_count(); ++i) scene.points[index.points[i]] = metric.points[i];
  }
  return scenes;
}

std::vector<uint8_t> agreeing_observations(const PointTracks& tracks, const UncalibratedScene& scene,
                                           const RadialDistortion& radial, std::span<const uint8_t> posed,
                                           std::span<const uint8_t> placed, double max_error_px) {
  std::vector<uint8_t> agrees(tracks.size(), 0);
  for (int k = 0; k < tracks.size(); ++k) {
    if (!posed[tracks.image[k]] || !placed[tracks.point[k]]) continue;
    agrees[k] = pixel_residual(tracks, scene, radial, k).norm() < max_error_px;
  }
  return agrees;
}

Result<void> settle(const PointTracks& tracks, const SolveOptions& options, bool equal, Solution* solution) {
  LensAdjustmentOptions adjustment = adjustment_of(tracks, options, equal);
  adjustment.with_sigma = true;
  if (!equal) adjustment.lens_of_image = options.lens_of_image;
  adjustment.loss = {RobustLoss::Kind::kHuber, options.max_error_px / 2};
  const auto judged = [&] {
    return agreeing_observations(tracks, solution->scene, {}, solution->image_posed, solution->point_placed,
                                 options.max_error_px);
  };
  solution->inlier = judged();
  const std::vector<double> kept(solution->inlier.begin(), solution->inlier.end());
  auto summary = adjust(tracks, kept, adjustment, options.method, &solution->scene);
  if (!summary) return summary.error();
  solution->summary = std::move(*summary);
  solution->inlier = judged();
  return {};
}

Result<Solution> best_solution(const PointTracks& tracks, const ProjectiveStart& start, const Units& units,
                               const SolveOptions& options, bool equal) {
  const LensAdjustmentOptions adjustment = adjustment_of(tracks, options, equal);
  const std::vector<double> weights(start.inlier.begin(), start.inlier.end());
  Solution best;
  double least = std::numeric_limits<double>::infinity();
  Error reason = no_reconstruction("self-calibration: no absolute quadric is positive, at any focal length");
  for (UncalibratedScene& scene : metric_starts(tracks, units, start, equal)) {
    if (options.stopped()) return interrupted();
    auto summary = adjust(tracks, weights, adjustment, options.method, &scene);
    if (!summary) {
      reason = summary.error();
      continue;
    }
    // What ended behind a camera or was dropped costs as much as an outlier.
    const double cost = summary->lm.final_cost +
                        0.5 * std::pow(options.max_error_px, 2) *
                            (double(std::count(start.inlier.begin(), start.inlier.end(), 1)) - summary->used);
    if (!(cost < least)) continue;
    least = cost;
    best.scene = std::move(scene);
  }
  if (!std::isfinite(least)) return reason;
  if (options.stopped()) return interrupted();
  best.image_posed = start.image_posed;
  best.point_placed = start.point_placed;
  std::copy_n(start.images, 2, best.start_images);
  best.start_inliers = start.pair_inliers;
  if (auto settled = settle(tracks, options, equal, &best); !settled) return settled.error();
  return best;
}

UncalibratedReconstruction filled(const PointTracks& tracks, Solution solution) {
  UncalibratedReconstruction result;
  result.image_posed.assign(tracks.image_count, 0);
  result.point_placed.assign(tracks.point_count, 0);
  std::vector<int> in_image(tracks.image_count, 0), of_point(tracks.point_count, 0);
  std::vector<int> seen(tracks.point_count, 0);
  for (int k = 0; k < tracks.size(); ++k) {
    in_image[tracks.image[k]] += solution.inlier[k];
    of_point[tracks.point[k]] += solution.inlier[k];
    seen[tracks.point[k]] += solution.image_posed[tracks.image[k]];
  }
  for (int j = 0; j < tracks.image_count; ++j)
    result.image_posed[j] = solution.image_posed[j] && in_image[j] >= kMinPointsPerImage;
  for (int i = 0; i < tracks.point_count; ++i) {
    result.point_placed[i] = of_point[i] >= 2 && 2 * of_point[i] > seen[i];
  }
  for (int k = 0; k < tracks.size(); ++k) {
    solution.inlier[k] &= result.image_posed[tracks.image[k]] & result.point_placed[tracks.point[k]];
  }
  result.rms_px = rms_error(tracks, solution.scene, {}, solution.inlier);
  result.scene = std::move(solution.scene);
  result.inlier = std::move(solution.inlier);
  result.lens_sigma = solution.summary.lens_sigma;
  result.adjustment = std::move(solution.summary);
  std::copy_n(solution.start_images, 2, result.start_images);
  result.start_inliers = solution.start_inliers;
  return result;
}

}  // namespace raysfm
