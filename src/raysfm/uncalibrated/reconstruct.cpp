#include "raysfm/uncalibrated/reconstruct.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "raysfm/projective/absolute_quadric.h"
#include "raysfm/projective/degeneracy.h"
#include "raysfm/projective/projective_start.h"
#include "raysfm/uncalibrated/lens_choice.h"
#include "raysfm/uncalibrated/scene_growth.h"

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
  std::vector<uint8_t> image_posed, point_placed;  // looked at by judge()
  int start_images[2] = {-1, -1};
  int start_inliers = 0;
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

// Adjusts with the observations that agree with the scene, and judges them anew.
Result<void> settle(const PointTracks& tracks, const SolveOptions& options, LensAdjustmentOptions adjustment,
                    Solution* solution) {
  adjustment.with_sigma = true;
  adjustment.loss = {RobustLoss::Kind::kHuber, options.max_error_px / 2};
  const auto judged = [&] {
    return judge(tracks, solution->scene, solution->image_posed, solution->point_placed,
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

LensAdjustmentOptions adjustment_of(const PointTracks& tracks, const SolveOptions& options, bool equal) {
  LensAdjustmentOptions adjustment;
  adjustment.constraints = constraints_for(tracks, options, equal);
  adjustment.method = options.constraints;
  adjustment.with_sigma = false;
  adjustment.lm.progress = &options.go_on;
  return adjustment;
}

// The candidate that ends in the least cost, adjusted again with the observations that then agree with it.
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
  if (auto settled = settle(tracks, options, adjustment, &best); !settled) return settled.error();
  return best;
}

// What the inliers of images and points that have enough of them say.
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

Result<ProjectiveStart> start_of(const PointTracks& tracks, const Units& units, const SolveOptions& options,
                                 int rank = 0) {
  return projective_start(units.apply(tracks), {.max_error = options.max_error_px / units.scale,
                                                .max_samples = options.max_samples,
                                                .seed = options.seed,
                                                .rank = rank,
                                                .progress = &options.go_on});
}

// Reconstructions of photos, with one lens or one for each: where a start leaves images out or leads nowhere,
// they are posed by the points of the others, other pairs are started from, and at last focal lengths are
// tried.
class PhotoSolver {
 public:
  PhotoSolver(const PointTracks& tracks, const Units& units, const SolveOptions& options)
      : tracks_(tracks), units_(units), options_(options), points_of_(tracks.image_count, 0) {
    for (const int image : tracks.image) ++points_of_[image];
  }

  Result<Solution> solve(const Result<ProjectiveStart>& first, bool equal) {
    Result<Solution> best = grown(solution_from(first, equal), equal);
    for (int rank = 1; rank < kStarts && left_out(best) > 0 && !options_.stopped(); ++rank) {
      if (!starts_[rank]) starts_[rank] = start_of(tracks_, units_, options_, rank);
      if (!*starts_[rank]) break;
      Result<Solution> other = grown(solution_from(*starts_[rank], equal), equal);
      if (is_better(other, best)) best = std::move(other);
    }
    if (!best && !options_.stopped()) best = euclidean(best.error(), equal);
    return best;
  }

 private:
  static constexpr int kStarts = 4, kUsable = 20;  // points of an image

  Result<Solution> solution_from(const Result<ProjectiveStart>& start, bool equal) const {
    if (!start) return start.error();
    return best_solution(tracks_, *start, units_, options_, equal);
  }

  // Marks images posed only where enough agrees, with a lens that can be.
  void unpose_weak(Solution* solution) const {
    const std::vector<int> counts = inliers_of_images(*solution);
    for (int j = 0; j < tracks_.image_count; ++j) {
      const double focal = solution->scene.lenses[j].fx / units_.scale;
      const bool can_be = focal > 0.2 && focal < 40;
      if (counts[j] < 2 * kMinPointsPerImage || !can_be) solution->image_posed[j] = 0;
    }
  }

  std::vector<int> inliers_of_images(const Solution& solution) const {
    std::vector<int> counts(tracks_.image_count, 0);
    for (int k = 0; k < tracks_.size(); ++k) counts[tracks_.image[k]] += solution.inlier[k];
    return counts;
  }

  // Images that could have a pose and have none.
  int left_out(const Result<Solution>& solution) const {
    if (!solution) return tracks_.image_count;
    int count = 0;
    for (int j = 0; j < tracks_.image_count; ++j)
      count += points_of_[j] >= kUsable && !solution->image_posed[j];
    return count;
  }

  bool is_better(const Result<Solution>& a, const Result<Solution>& b) const {
    if (!a || !b) return a.ok();
    const int out_a = left_out(a), out_b = left_out(b);
    if (out_a != out_b) return out_a < out_b;
    return std::ranges::count(a->inlier, 1) > std::ranges::count(b->inlier, 1);
  }

  // With images that were left out posed by the points of the others, as long as that gains any.
  Result<Solution> grown(Result<Solution> solution, bool equal) const {
    constexpr int kRounds = 4;
    if (!solution) return solution;
    unpose_weak(&*solution);
    for (int round = 0; round < kRounds && left_out(solution) > 0 && !options_.stopped(); ++round) {
      GrowingScene growing{solution->scene, solution->image_posed, solution->point_placed};
      keep_good_points(*solution, &growing);
      place_left_points(tracks_, options_.max_error_px, &growing);
      if (pose_left_images(tracks_, options_, !equal, &growing) == 0) break;
      Result<Solution> more = settled(std::move(growing), *solution, equal);
      if (!is_better(more, solution)) break;
      solution = std::move(more);
    }
    return solution;
  }

  void keep_good_points(const Solution& solution, GrowingScene* growing) const {
    std::vector<int> counts(tracks_.point_count, 0);
    for (int k = 0; k < tracks_.size(); ++k) {
      counts[tracks_.point[k]] += solution.inlier[k] & solution.image_posed[tracks_.image[k]];
    }
    for (int i = 0; i < tracks_.point_count; ++i) growing->point_placed[i] &= counts[i] >= 2;
  }

  // A grown scene adjusted twice: what was placed before may agree with what the first gives.
  Result<Solution> settled(GrowingScene growing, const Solution& before, bool equal) const {
    Solution solution;
    std::copy_n(before.start_images, 2, solution.start_images);
    solution.start_inliers = before.start_inliers;
    const LensAdjustmentOptions adjustment = adjustment_of(tracks_, options_, equal);
    for (int pass = 0; pass < 2; ++pass) {
      if (options_.stopped()) return interrupted();
      solution.scene = std::move(growing.scene);
      solution.image_posed = growing.image_posed;
      solution.point_placed = growing.point_placed;
      if (auto r = settle(tracks_, options_, adjustment, &solution); !r) return r.error();
      unpose_weak(&solution);
      if (pass == 1) break;
      growing = {solution.scene, solution.image_posed, solution.point_placed};
      keep_good_points(solution, &growing);
      place_left_points(tracks_, options_.max_error_px, &growing);
    }
    return solution;
  }

  // From the first pairs with one focal length after the other; the one with which most agrees.
  Result<Solution> euclidean(const Error& reason, bool equal) const {
    constexpr std::array kFocals = {1.0, 1.4, 2.0, 2.8, 4.0, 5.6};  // of half the larger side
    const ImageObservations observations(tracks_);
    Result<Solution> best = reason;
    for (int rank = 0; rank < 2; ++rank) {
      const auto pair =
          farthest_pair(observations, options_.max_error_px, options_.max_samples, options_.seed, rank);
      if (!pair) break;
      for (const double focal : kFocals) {
        GrowingScene growing;
        if (options_.stopped()) return interrupted();
        if (!euclidean_start(tracks_, *pair, focal * units_.scale, &growing)) continue;
        // A wrong focal length bends the scene: errors are allowed for until the lens is adjusted.
        SolveOptions loose = options_;
        loose.max_error_px *= 3;
        place_left_points(tracks_, loose.max_error_px, &growing);
        pose_left_images(tracks_, loose, false, &growing);
        Solution before;
        std::copy_n(pair->images, 2, before.start_images);
        before.start_inliers = pair->inliers;
        Result<Solution> solution = grown(settled(std::move(growing), before, equal), equal);
        if (solution && is_better(solution, best)) best = std::move(solution);
      }
    }
    return best;
  }

  const PointTracks& tracks_;
  const Units& units_;
  const SolveOptions& options_;
  std::vector<int> points_of_;
  std::array<std::optional<Result<ProjectiveStart>>, kStarts> starts_;
};

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
  PhotoSolver photos(tracks, units, options);
  const auto solved = [&](bool equal) -> Result<UncalibratedReconstruction> {
    auto solution = options.errors == ErrorRelation::kWithinImages
                        ? photos.solve(start, equal)
                        : best_solution(tracks, *start, units, options, equal);
    if (!solution) return solution.error();
    UncalibratedReconstruction result = filled(tracks, std::move(*solution));
    result.zooming = !equal;
    result.lens_evidence = "as asked for";
    return result;
  };
  const std::vector<uint8_t> all(tracks.image_count, 1);
  auto result = options.lens == LensChange::kAuto ? choose_lens(tracks, all, solved(true), solved(false),
                                                                options.max_error_px, options.errors)
                                                  : solved(options.lens == LensChange::kFixed);
  if (!result) return result;
  result->degenerate =
      name_degeneracy(result->scene, result->image_posed, result->point_placed, result->lens_sigma);
  return result;
}

}  // namespace raysfm
