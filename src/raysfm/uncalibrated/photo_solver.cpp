#include "raysfm/uncalibrated/photo_solver.h"

#include <algorithm>
#include <utility>

namespace raysfm {
namespace {

constexpr int kUsable = 20;  // points of an image

}  // namespace

PhotoSolver::PhotoSolver(const PointTracks& tracks, const Units& units, const SolveOptions& options)
    : tracks_(tracks), units_(units), options_(options), points_of_(tracks.image_count, 0) {
  for (const int image : tracks.image) ++points_of_[image];
}

Result<Solution> PhotoSolver::solve(const Result<ProjectiveStart>& first, bool equal) {
  Result<Solution> best = grown(solution_from(first, equal), equal);
  for (int rank = 1; rank < kStarts && left_out(best) > 0 && !options_.stopped(); ++rank) {
    if (!starts_[rank]) starts_[rank] = start_of(tracks_, units_, options_, rank);
    if (!*starts_[rank]) break;
    Result<Solution> other = grown(solution_from(*starts_[rank], equal), equal);
    if (is_better(other, best)) best = std::move(other);
  }
  if ((!best || (options_.focal_sigma > 0 && left_out(best) > 0)) && !options_.stopped()) {
    Result<Solution> other = euclidean(equal);
    if (other && is_better(other, best)) best = std::move(other);
  }
  return best;
}

Result<Solution> PhotoSolver::solution_from(const Result<ProjectiveStart>& start, bool equal) const {
  if (!start) return start.error();
  return best_solution(tracks_, *start, units_, options_, equal);
}

// Marks images posed only where enough agrees, with a lens that can be.
void PhotoSolver::unpose_weak(Solution* solution) const {
  const std::vector<int> counts = inliers_of_images(*solution);
  for (int j = 0; j < tracks_.image_count; ++j) {
    const double focal = solution->scene.lenses[j].fx / units_.scale;
    const bool can_be = focal > 0.2 && focal < 40;
    if (counts[j] < 2 * kMinPointsPerImage || !can_be) solution->image_posed[j] = 0;
  }
}

std::vector<int> PhotoSolver::inliers_of_images(const Solution& solution) const {
  std::vector<int> counts(tracks_.image_count, 0);
  for (int k = 0; k < tracks_.size(); ++k) counts[tracks_.image[k]] += solution.inlier[k];
  return counts;
}

// Images that could have a pose and have none.
int PhotoSolver::left_out(const Result<Solution>& solution) const {
  if (!solution) return tracks_.image_count;
  int count = 0;
  for (int j = 0; j < tracks_.image_count; ++j)
    count += points_of_[j] >= kUsable && !solution->image_posed[j];
  return count;
}

bool PhotoSolver::is_better(const Result<Solution>& a, const Result<Solution>& b) const {
  if (!a || !b) return a.ok();
  const int out_a = left_out(a), out_b = left_out(b);
  if (out_a != out_b) return out_a < out_b;
  return std::ranges::count(a->inlier, 1) > std::ranges::count(b->inlier, 1);
}

// With images that were left out posed by the points of the others, as long as that gains any.
Result<Solution> PhotoSolver::grown(Result<Solution> solution, bool equal) const {
  constexpr int kRounds = 4;
  if (!solution) return solution;
  unpose_weak(&*solution);
  for (int round = 0; round < kRounds && left_out(solution) > 0 && !options_.stopped(); ++round) {
    GrowingScene growing{solution->scene, solution->image_posed, solution->point_placed};
    keep_good_points(*solution, &growing);
    place_left_points(tracks_, options_.max_error_px, &growing);
    // Points alone, placed and adjusted once, may be what an image lacks.
    if (pose_left_images(tracks_, options_, !equal, &growing) == 0 && round > 0) break;
    Result<Solution> more = settled(std::move(growing), *solution, equal);
    if (!is_better(more, solution)) break;
    solution = std::move(more);
  }
  return solution;
}

void PhotoSolver::keep_good_points(const Solution& solution, GrowingScene* growing) const {
  std::vector<int> counts(tracks_.point_count, 0);
  for (int k = 0; k < tracks_.size(); ++k) {
    counts[tracks_.point[k]] += solution.inlier[k] & solution.image_posed[tracks_.image[k]];
  }
  for (int i = 0; i < tracks_.point_count; ++i) growing->point_placed[i] &= counts[i] >= 2;
}

// A grown scene adjusted twice: what was placed before may agree with what the first gives.
Result<Solution> PhotoSolver::settled(GrowingScene growing, const Solution& before, bool equal) const {
  Solution solution;
  std::copy_n(before.start_images, 2, solution.start_images);
  solution.start_inliers = before.start_inliers;
  for (int pass = 0; pass < 2; ++pass) {
    if (options_.stopped()) return interrupted();
    solution.scene = std::move(growing.scene);
    solution.image_posed = growing.image_posed;
    solution.point_placed = growing.point_placed;
    if (auto r = settle(tracks_, options_, equal, &solution); !r) return r.error();
    unpose_weak(&solution);
    if (pass == 1) break;
    growing = {solution.scene, solution.image_posed, solution.point_placed};
    keep_good_points(solution, &growing);
    place_left_points(tracks_, options_.max_error_px, &growing);
  }
  return solution;
}

// From the first pairs with the focal length that is said, or with one after the other; the one with which
// most agrees.
Result<Solution> PhotoSolver::euclidean(bool equal) const {
  constexpr std::array kFocals = {1.0, 1.4, 2.0, 2.8, 4.0, 5.6};  // of half the larger side
  std::vector<double> focals;
  for (const double focal : kFocals) focals.push_back(focal * units_.scale);
  if (options_.focal_sigma > 0) focals = {options_.focal};
  const ImageObservations observations(tracks_);
  Result<Solution> best = no_reconstruction("start: no focal length puts the points in front of two images");
  for (int rank = 0; rank < 2; ++rank) {
    const auto pair =
        farthest_pair(observations, options_.max_error_px, options_.max_samples, options_.seed, rank);
    if (!pair) break;
    for (const double focal : focals) {
      if (options_.stopped()) return interrupted();
      Result<Solution> solution = euclidean_from(*pair, focal, equal);
      if (solution && is_better(solution, best)) best = std::move(solution);
    }
  }
  return best;
}

Result<Solution> PhotoSolver::euclidean_from(const ViewPair& pair, double focal, bool equal) const {
  GrowingScene growing;
  if (!euclidean_start(tracks_, pair, focal, options_, &growing)) {
    return no_reconstruction("start: hardly a point is in front of both images");
  }
  // A wrong focal length bends the scene: errors are allowed for until the lens is adjusted.
  SolveOptions loose = options_;
  loose.max_error_px *= 3;
  place_left_points(tracks_, loose.max_error_px, &growing);
  pose_left_images(tracks_, loose, false, &growing);
  Solution before;
  std::copy_n(pair.images, 2, before.start_images);
  before.start_inliers = pair.inliers;
  return grown(settled(std::move(growing), before, equal), equal);
}

}  // namespace raysfm
