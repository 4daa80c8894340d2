#include "raysfm/projective/view_pair.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <numeric>
#include <string>

#include "raysfm/core/median.h"
#include "raysfm/projective/eight_point.h"
#include "raysfm/projective/homography_cause.h"
#include "raysfm/projective/match_estimator.h"

namespace raysfm {
namespace {

constexpr int kMinMatches = 8;
constexpr size_t kMaxHomographyMatches = 100;  // more tell no more about how far apart two views are

struct Fundamental {
  static constexpr int kSampleSize = 8, kRounds = 3;
  static bool fit(std::span<const Eigen::Vector2d> a, std::span<const Eigen::Vector2d> b,
                  Eigen::Matrix3d* model) {
    return fundamental_from_points(a, b, model);
  }
  static double error2(const Eigen::Matrix3d& model, const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
    return sampson_error2(model, a, b);
  }
};

// Median distance that the best homography over all matches leaves.
double homography_residual(const PairMatches& matches) {
  const size_t step = 1 + (matches.a.size() - 1) / kMaxHomographyMatches;
  std::vector<Eigen::Vector2d> a, b;
  for (size_t i = 0; i < matches.a.size(); i += step) a.push_back(matches.a[i]), b.push_back(matches.b[i]);
  Eigen::Matrix3d homography;
  if (!homography_from_points(a, b, &homography)) return 0;
  std::vector<double> distances;
  for (size_t i = 0; i < a.size(); ++i) {
    distances.push_back(((homography * a[i].homogeneous()).hnormalized() - b[i]).norm());
  }
  return median_of(&distances);
}

PairMatches inliers_of(const ViewPair& pair) {
  PairMatches kept;
  for (size_t i = 0; i < pair.matches.a.size(); ++i) {
    if (!pair.inlier[i]) continue;
    kept.points.push_back(pair.matches.points[i]);
    kept.a.push_back(pair.matches.a[i]);
    kept.b.push_back(pair.matches.b[i]);
  }
  return kept;
}

struct RankedPair {
  int a, b;
  double parallax;
  size_t count;
};

std::vector<RankedPair> rank_pairs(const ImageObservations& observations) {
  std::vector<RankedPair> pairs;
  // Every pair of up to about 60 images, fewer of more.
  const int step = 1 + observations.images() / 60;
  size_t most = 0;
  for (int a = 0; a < observations.images(); a += step) {
    for (int b = a + 1; b < observations.images(); b += step) {
      const PairMatches matches = observations.matches(a, b);
      if (matches.a.size() < kMinMatches) continue;
      most = std::max(most, matches.a.size());
      pairs.push_back({a, b, homography_residual(matches), matches.a.size()});
    }
  }
  std::erase_if(pairs, [&](const RankedPair& pair) { return pair.count < std::min<size_t>(50, most / 2); });
  std::stable_sort(pairs.begin(), pairs.end(), [](const RankedPair& x, const RankedPair& y) {
    return x.parallax * std::sqrt(double(x.count)) > y.parallax * std::sqrt(double(y.count));
  });
  return pairs;
}

// Why no pair has an epipolar geometry of its own.
Error no_parallax(const ImageObservations& observations, const std::vector<RankedPair>& ranked,
                  double max_error) {
  constexpr size_t kMaxPairs = 20;
  std::vector<Eigen::Matrix3d> homographies;
  for (size_t i = 0; i < ranked.size() && homographies.size() < kMaxPairs; ++i) {
    const PairMatches matches = observations.matches(ranked[i].a, ranked[i].b);
    Eigen::Matrix3d homography;
    if (ranked[i].parallax > max_error) continue;
    if (homography_from_points(matches.a, matches.b, &homography)) homographies.push_back(homography);
  }
  if (homographies.empty()) {
    return no_reconstruction("start: the matches of no two images agree with an epipolar geometry");
  }
  const std::string found = "start: a homography relates every two images: ";
  switch (homography_cause(homographies)) {
    case HomographyCause::kRotation:
      return no_reconstruction(found + "pure rotation, the camera turns in one place");
    case HomographyCause::kPlane:
      return no_reconstruction(
          found + "planar scene, which tells lenses only where the positions of its points are known");
    case HomographyCause::kStill:
      return no_reconstruction(found + "no parallax, the camera hardly moves");
    case HomographyCause::kUnclear:
      break;
  }
  return no_reconstruction(found + "pure rotation or a planar scene");
}

}  // namespace

ImageObservations::ImageObservations(const PointTracks& tracks)
    : tracks_(tracks), begin_(tracks.image_count + 1, 0), observations_(tracks.size()) {
  std::iota(observations_.begin(), observations_.end(), 0);
  std::sort(observations_.begin(), observations_.end(), [&](int x, int y) {
    return std::pair(tracks.image[x], tracks.point[x]) < std::pair(tracks.image[y], tracks.point[y]);
  });
  for (const int image : tracks.image) ++begin_[image + 1];
  for (int j = 0; j < tracks.image_count; ++j) begin_[j + 1] += begin_[j];
}

PairMatches ImageObservations::matches(int a, int b) const {
  PairMatches matches;
  const int *x = begin(a), *y = begin(b);
  while (x != end(a) && y != end(b)) {
    const int of_x = tracks_.point[*x], of_y = tracks_.point[*y];
    if (of_x == of_y) {
      matches.points.push_back(of_x);
      matches.a.push_back(tracks_.pixel[*x]);
      matches.b.push_back(tracks_.pixel[*y]);
    }
    if (of_x <= of_y) ++x;
    if (of_y <= of_x) ++y;
  }
  return matches;
}

int farthest_partner(const ImageObservations& observations, std::span<const int> images, std::size_t first) {
  constexpr int kLeastMatches = 30;
  const int enough = std::max(kLeastMatches, observations.count(images[first]) / 4);
  int partner = -1;
  for (std::size_t j = first + 1; j < images.size(); ++j) {
    if (static_cast<int>(observations.matches(images[first], images[j]).a.size()) < enough) break;
    partner = images[j];
  }
  return partner;
}

bool fundamental_ransac(const PairMatches& matches, double max_error, int max_samples, uint64_t seed,
                        uint64_t stream, ViewPair* pair) {
  MatchEstimator<Fundamental> estimator(matches, max_error);
  const RansacOptions options{.max_iterations = max_samples, .seed = seed, .stream = stream};
  const RansacReport report = ransac(estimator, options, &pair->fundamental);
  if (!report.found() || report.score.inliers < kMinMatches) return false;
  pair->matches = matches;
  pair->inliers = report.score.inliers;
  pair->inlier.clear();
  for (size_t i = 0; i < matches.a.size(); ++i) {
    pair->inlier.push_back(sampson_error2(pair->fundamental, matches.a[i], matches.b[i]) <
                           max_error * max_error);
  }
  return true;
}

Result<ViewPair> farthest_pair(const ImageObservations& observations, double max_error, int max_samples,
                               uint64_t seed, int rank) {
  constexpr size_t kMaxTried = 8, kMaxTriedAgain = 30;
  const std::vector<RankedPair> ranked = rank_pairs(observations);
  if (ranked.empty()) {
    return no_reconstruction("start: no two images share " + std::to_string(kMinMatches) +
                             " points, the fewest that give their epipolar geometry");
  }
  std::vector<std::pair<double, ViewPair>> found;
  for (size_t i = 0; i < std::min(rank > 0 ? kMaxTriedAgain : kMaxTried, ranked.size()); ++i) {
    ViewPair pair;
    pair.images[0] = ranked[i].a, pair.images[1] = ranked[i].b;
    if (!fundamental_ransac(observations.matches(ranked[i].a, ranked[i].b), max_error, max_samples, seed, i,
                            &pair)) {
      continue;
    }
    const double share = double(pair.inliers) / double(pair.matches.a.size());
    const double parallax = homography_residual(inliers_of(pair));
    if (parallax > max_error) found.emplace_back(parallax * pair.inliers * share, std::move(pair));
  }
  if (found.empty()) return no_parallax(observations, ranked, max_error);
  std::stable_sort(found.begin(), found.end(),
                   [](const auto& x, const auto& y) { return x.first > y.first; });
  std::vector<uint8_t> taken(observations.images(), 0);
  for (auto& [score, pair] : found) {
    if (taken[pair.images[0]] || taken[pair.images[1]]) continue;
    if (rank-- == 0) return std::move(pair);
    taken[pair.images[0]] = taken[pair.images[1]] = 1;
  }
  return no_reconstruction("start: there is no further pair of images to start from");
}

}  // namespace raysfm
