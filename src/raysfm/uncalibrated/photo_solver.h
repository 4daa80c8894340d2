#pragma once

#include <array>
#include <optional>
#include <vector>

#include "raysfm/projective/view_pair.h"
#include "raysfm/uncalibrated/scene_growth.h"
#include "raysfm/uncalibrated/solution.h"

namespace raysfm {

// Reconstructions of photos, with one lens or one for each: where a start leaves images out or leads nowhere,
// they are posed by the points of the others, other pairs are started from, and at last focal lengths are
// tried.
class PhotoSolver {
 public:
  // Everything must outlive the object.
  PhotoSolver(const PointTracks& tracks, const Units& units, const SolveOptions& options);

  // From this start first. `equal`: one lens for all images. Errors: kNoReconstruction with the reason.
  Result<Solution> solve(const Result<ProjectiveStart>& first, bool equal);

 private:
  static constexpr int kStarts = 4;

  Result<Solution> solution_from(const Result<ProjectiveStart>& start, bool equal) const;
  void unpose_weak(Solution* solution) const;
  std::vector<int> inliers_of_images(const Solution& solution) const;
  int left_out(const Result<Solution>& solution) const;
  bool is_better(const Result<Solution>& a, const Result<Solution>& b) const;
  Result<Solution> grown(Result<Solution> solution, bool equal) const;
  void keep_good_points(const Solution& solution, GrowingScene* growing) const;
  Result<Solution> settled(GrowingScene growing, const Solution& before, bool equal) const;
  Result<Solution> euclidean(bool equal) const;
  Result<Solution> euclidean_from(const ViewPair& pair, double focal, bool equal) const;

  const PointTracks& tracks_;
  const Units& units_;
  const SolveOptions& options_;
  std::vector<int> points_of_;
  std::array<std::optional<Result<ProjectiveStart>>, kStarts> starts_;
};

}  // namespace raysfm
