#include "raysfm/uncalibrated/reconstruct.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "raysfm/projective/absolute_quadric.h"
#include "raysfm/projective/degeneracy.h"
#include "raysfm/projective/projective_start.h"
#include "raysfm/uncalibrated/lens_choice.h"

namespace raysfm {
namespace {

constexpr int kCandidates = 3;

Result<void> check_options(const SolveOptions& options) {
  if (!(options.max_error_px > 0)) return bad_input("max_error_px: must be above 0");
  if (!(options.principal_point_sigma >= 0)) return bad_input("principal_point_sigma: must be 0 or more");
  if (options.max_samples < 1) return bad_input("max_samples: must be 1 or more");
  return {};
}

// Images that could take part in a start, and as many as what is known of the lenses asks for.
Result<void> check_amount(const PointTracks& tracks, const LensConstraints& constraints) {
  constexpr int kMinPoints = 8;
  std::vector<int> points(tracks.image_count, 0);
  for (const int image : tracks.image) ++points[image];
  const auto usable =
      std::count_if(points.begin(), points.end(), [](int count) { return count >= kMinPoints; });
  const int needed = std::max(2, min_images(constraints));
  if (usable >= needed) return {};
  return no_reconstruction("images: " + std::to_string(usable) + " with at least " +
                           std::to_string(kMinPoints) + " points, at least " + std::to_string(needed) +
                           " are needed (known of the lenses: " + describe(constraints) + ")");
}

// Tracks in units of half the image's larger side about its centre.
struct Units {
  double scale;
  Eigen::Vector2d centre;

  explicit Units(const PointTracks& tracks)
      : scale(0.5 * tracks.image_size.maxCoeff()), centre(tracks.centre()) {}
  PointTracks apply(const PointTracks& tracks) const {
    PointTracks scaled = tracks;
    for (Eigen::Vector2d& p : scaled.pixel) p = (p - centre) / scale;
    return scaled;
  }
  Lens undo(const Lens& lens) const {
    return {scale * lens.fx, scale * lens.fy, scale * lens.cx + centre.x(), scale * lens.cy + centre.y(),
            scale * lens.skew};
  }
};

// Metric scenes of all images and points; what is not posed or placed is zero.
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

Result<LensAdjustmentSummary> adjust(const PointTracks& tracks, const std::vector<double>& weights,
                                     const LensAdjustmentOptions& options, LensMethod method,
                                     UncalibratedScene* scene) {
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

struct Solution {
  UncalibratedScene scene;
  LensAdjustmentSummary summary;
  std::vector<uint8_t> inlier;
};

// Where the scene agrees with the observations, of images posed and points placed.
std::vector<uint8_t> judge(const PointTracks& tracks, const UncalibratedScene& scene,
                           const std::vector<uint8_t>& posed, const std::vector<uint8_t>& placed,
                           double max_error) {
  std::vector<uint8_t> inlier(tracks.size(), 0);
  for (int k = 0; k < tracks.size(); ++k) {
    const int image = tracks.image[k], point = tracks.point[k];
    if (!posed[image] || !placed[point]) continue;
    inlier[k] = pixel_residual(tracks, scene, {}, k).norm() < max_error;
  }
  return inlier;
}

Error interrupted() {
  return no_reconstruction("interrupted");
}

// The candidate that ends in the least cost, adjusted again with the observations that then agree with it.
Result<Solution> best_solution(const PointTracks& tracks, const ProjectiveStart& start, const Units& units,
                               const SolveOptions& options, bool equal) {
  LensAdjustmentOptions adjustment;
  adjustment.constraints = constraints_for(tracks, options, equal);
  adjustment.method = options.constraints;
  adjustment.with_sigma = false;
  adjustment.lm.progress = &options.go_on;
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
  adjustment.with_sigma = true;
  adjustment.loss = {RobustLoss::Kind::kHuber, options.max_error_px / 2};
  best.inlier = judge(tracks, best.scene, start.image_posed, start.point_placed, options.max_error_px);
  const std::vector<double> kept(best.inlier.begin(), best.inlier.end());
  auto summary = adjust(tracks, kept, adjustment, options.method, &best.scene);
  if (!summary) return summary.error();
  best.summary = std::move(*summary);
  best.inlier = judge(tracks, best.scene, start.image_posed, start.point_placed, options.max_error_px);
  return best;
}

// What the inliers of images and points that have enough of them say.
UncalibratedReconstruction filled(const PointTracks& tracks, const ProjectiveStart& start,
                                  Solution solution) {
  UncalibratedReconstruction result;
  result.image_posed.assign(tracks.image_count, 0);
  result.point_placed.assign(tracks.point_count, 0);
  std::vector<int> in_image(tracks.image_count, 0), of_point(tracks.point_count, 0);
  std::vector<int> seen(tracks.point_count, 0);
  for (int k = 0; k < tracks.size(); ++k) {
    in_image[tracks.image[k]] += solution.inlier[k];
    of_point[tracks.point[k]] += solution.inlier[k];
    seen[tracks.point[k]] += start.image_posed[tracks.image[k]];
  }
  for (int j = 0; j < tracks.image_count; ++j) result.image_posed[j] = in_image[j] >= kMinPointsPerImage;
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
  std::copy_n(start.images, 2, result.start_images);
  result.start_inliers = start.pair_inliers;
  return result;
}

Result<ProjectiveStart> start_of(const PointTracks& tracks, const Units& units, const SolveOptions& options) {
  return projective_start(units.apply(tracks), {.max_error = options.max_error_px / units.scale,
                                                .max_samples = options.max_samples,
                                                .seed = options.seed,
                                                .progress = &options.go_on});
}

}  // namespace

LensConstraints constraints_for(const PointTracks& tracks, const SolveOptions& options, bool equal) {
  LensConstraints constraints;
  constraints.equal = equal;
  constraints.principal_point = tracks.centre();
  // Relative to the noise of an observation, of which a third of the largest error allowed is a fair guess.
  constraints.principal_point_sigma =
      options.principal_point_sigma * tracks.image_size.maxCoeff() / (options.max_error_px / 3);
  return constraints;
}

Result<UncalibratedScene> linear_start(const PointTracks& tracks, const SolveOptions& options,
                                       bool equal_lenses) {
  if (auto ok = validate(tracks); !ok) return ok.error();
  if (auto ok = check_options(options); !ok) return ok.error();
  const Units units(tracks);
  const auto start = start_of(tracks, units, options);
  if (!start) return start.error();
  const auto whole = [](const std::vector<uint8_t>& marks) {
    return std::all_of(marks.begin(), marks.end(), [](uint8_t mark) { return mark; });
  };
  if (!whole(start->image_posed) || !whole(start->point_placed)) {
    return no_reconstruction("start: an image or a point was not reached");
  }
  std::vector<UncalibratedScene> scenes = metric_starts(tracks, units, *start, equal_lenses);
  if (scenes.empty()) {
    return no_reconstruction("self-calibration: no absolute quadric is positive, at any focal length");
  }
  return std::move(scenes.front());
}

Result<UncalibratedReconstruction> reconstruct(const PointTracks& tracks, const SolveOptions& options) {
  if (auto ok = validate(tracks); !ok) return ok.error();
  if (auto ok = check_options(options); !ok) return ok.error();
  if (auto ok = check_amount(tracks, constraints_for(tracks, options, options.lens != LensChange::kZoom));
      !ok) {
    return ok.error();
  }
  const Units units(tracks);
  const auto start = start_of(tracks, units, options);
  if (!start) return start.error();
  const auto solved = [&](bool equal) -> Result<UncalibratedReconstruction> {
    auto solution = best_solution(tracks, *start, units, options, equal);
    if (!solution) return solution.error();
    UncalibratedReconstruction result = filled(tracks, *start, std::move(*solution));
    result.zooming = !equal;
    result.lens_evidence = "as asked for";
    return result;
  };
  const std::vector<uint8_t> all(tracks.image_count, 1);
  auto result = options.lens == LensChange::kAuto ? choose_lens(tracks, all, solved(true), solved(false),
                                                                options.max_error_px, ErrorRelation::kNone)
                                                  : solved(options.lens == LensChange::kFixed);
  if (!result) return result;
  result->degenerate =
      name_degeneracy(result->scene, result->image_posed, result->point_placed, result->lens_sigma);
  return result;
}

}  // namespace raysfm
