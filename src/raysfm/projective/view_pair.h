#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/lenses/point_tracks.h"

namespace raysfm {

// Points seen in both of two images.
struct PairMatches {
  std::vector<int> points;
  std::vector<Eigen::Vector2d> a, b;
};

// Observations by image: the point and its pixel, points ascending.
class ImageObservations {
 public:
  explicit ImageObservations(const PointTracks& tracks);

  int images() const { return static_cast<int>(begin_.size()) - 1; }
  int count(int image) const { return begin_[image + 1] - begin_[image]; }
  // Numbers of the observations of an image.
  const int* begin(int image) const { return observations_.data() + begin_[image]; }
  const int* end(int image) const { return observations_.data() + begin_[image + 1]; }
  PairMatches matches(int a, int b) const;

 private:
  const PointTracks& tracks_;
  std::vector<int> begin_, observations_;
};

// The last of `images` after the one at `first` before one that shares too little with it: less than 30
// points, or than a quarter of those that it sees; -1 without one.
int farthest_partner(const ImageObservations& observations, std::span<const int> images, std::size_t first);

// Two images, their matches and their fundamental matrix.
struct ViewPair {
  int images[2] = {-1, -1};
  Eigen::Matrix3d fundamental = Eigen::Matrix3d::Zero();
  PairMatches matches;
  std::vector<uint8_t> inlier;  // of the matches
  int inliers = 0;
};

// RANSAC over samples of eight with local optimisation; false when no 8 matches agree.
bool fundamental_ransac(const PairMatches& matches, double max_error, int max_samples, uint64_t seed,
                        uint64_t stream, ViewPair* pair);

// The pair of most parallax: many matches that a homography leaves far apart; with a `rank` above 0 the best
// after so many, which has no image in common with those. kNoReconstruction as projective_start().
Result<ViewPair> farthest_pair(const ImageObservations& observations, double max_error, int max_samples,
                               uint64_t seed, int rank = 0);

}  // namespace raysfm
