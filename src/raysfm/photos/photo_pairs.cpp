#include "raysfm/photos/photo_pairs.h"

#include <algorithm>
#include <utility>

#include "raysfm/places/place_index.h"
#include "raysfm/projective/view_pair.h"
#include "raysfm/robust/essential_ransac.h"

namespace raysfm {
namespace {

constexpr int kMostAlike = 20;  // photos that one is compared with because they look alike
constexpr int kInTurn = 2;      // that were taken before it, and after it
constexpr int kPairSamples = 2000;
constexpr int kMinPairInliers = 20;

std::vector<std::pair<int, int>> all_pairs(int photos) {
  std::vector<std::pair<int, int>> pairs;
  for (int a = 0; a < photos; ++a) {
    for (int b = a + 1; b < photos; ++b) pairs.emplace_back(a, b);
  }
  return pairs;
}

uint64_t stream_of(int a, int b) {
  return (uint64_t{static_cast<uint32_t>(a)} << 32) + static_cast<uint32_t>(b);
}

// Two photos and what is clear enough of their matches.
struct ClearPair {
  int a, b;
  SamePoints matches;
};

ClearPair clear_matches(const MatchedPairs& pairs, int number, float max_ratio) {
  ClearPair pair{pairs.photos[number].first, pairs.photos[number].second, {}};
  for (const PhotoMatch& match : pairs.matches[number]) {
    if (match.ratio < max_ratio) pair.matches.emplace_back(match.in_a, match.in_b);
  }
  return pair;
}

// Of one central camera.
SamePoints same_points_along_rays(const PhotoFeatures& features, const ClearPair& pair, const Camera& camera,
                                  const PairOptions& options) {
  SamePoints found;
  std::vector<Eigen::Vector3d> bearings[2];
  for (const auto& [a, b] : pair.matches) {
    Ray in_a, in_b;
    if (!camera.ray(features.pixels(pair.a)[a], &in_a) || !camera.ray(features.pixels(pair.b)[b], &in_b))
      continue;
    found.emplace_back(a, b);
    bearings[0].push_back(in_a.direction);
    bearings[1].push_back(in_b.direction);
  }
  EssentialRansac estimator(bearings[0], bearings[1], options.max_error_px / camera.pixels_per_radian());
  Eigen::Matrix3d essential;
  const RansacReport report = ransac(
      estimator, {.max_iterations = kPairSamples, .seed = options.seed, .stream = stream_of(pair.a, pair.b)},
      &essential);
  if (!report.found() || report.score.inliers < kMinPairInliers) return {};
  SamePoints same;
  for (int i = 0; i < estimator.size(); ++i) {
    if (estimator.is_inlier(essential, i)) same.push_back(found[i]);
  }
  return same;
}

SamePoints same_points(const PhotoFeatures& features, const ClearPair& pair, const PairOptions& options) {
  PairMatches matches;
  for (const auto& [a, b] : pair.matches) {
    matches.points.push_back(static_cast<int>(matches.points.size()));
    matches.a.push_back(features.pixels(pair.a)[a]);
    matches.b.push_back(features.pixels(pair.b)[b]);
  }
  ViewPair geometry;
  if (!fundamental_ransac(matches, options.max_error_px, kPairSamples, options.seed,
                          stream_of(pair.a, pair.b), &geometry) ||
      geometry.inliers < kMinPairInliers)
    return {};
  SamePoints same;
  for (size_t i = 0; i < geometry.inlier.size(); ++i) {
    if (geometry.inlier[i]) same.push_back(pair.matches[geometry.matches.points[i]]);
  }
  return same;
}

}  // namespace

std::vector<std::pair<int, int>> pairs_to_compare(const PhotoFeatures& features, ThreadPool* pool) {
  const int photos = features.photos();
  if (photos <= kMostInAllPairs) return all_pairs(photos);
  PlaceIndex index;
  for (int j = 0; j < photos; ++j) index.add(features.codes(j));
  std::vector<std::vector<std::pair<int, int>>> of_photo(photos);
  pool->parallel_for(photos, [&](int j) {
    std::vector<uint8_t> self(photos, 0);
    self[j] = 1;
    for (const PlaceVotes& alike : index.search(features.codes(j), self, kMostAlike)) {
      of_photo[j].push_back(std::minmax(j, alike.place));
    }
    for (int next = j + 1; next <= std::min(j + kInTurn, photos - 1); ++next)
      of_photo[j].emplace_back(j, next);
  });
  std::vector<std::pair<int, int>> pairs;
  for (const auto& some : of_photo) pairs.insert(pairs.end(), some.begin(), some.end());
  std::ranges::sort(pairs);
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  return pairs;
}

MatchedPairs match_pairs(const PhotoFeatures& features, std::vector<std::pair<int, int>> pairs,
                         const std::atomic<bool>* stop, ThreadPool* pool) {
  MatchedPairs matched{std::move(pairs), {}};
  matched.matches.resize(matched.photos.size());
  pool->parallel_for(static_cast<int>(matched.photos.size()), [&](int i) {
    if (stop && stop->load()) return;
    matched.matches[i] = features.match(matched.photos[i].first, matched.photos[i].second, kLooseRatio);
  });
  return matched;
}

std::vector<SamePoints> compare_pairs(const PhotoFeatures& features, const MatchedPairs& pairs,
                                      const PairOptions& options, ThreadPool* pool) {
  std::vector<SamePoints> same(pairs.photos.size());
  pool->parallel_for(static_cast<int>(pairs.photos.size()), [&](int i) {
    if (options.stop && options.stop->load()) return;
    const auto& [a, b] = pairs.photos[i];
    if (!options.posed.empty() && options.posed[a] && options.posed[b]) return;
    const ClearPair pair = clear_matches(pairs, i, options.max_ratio);
    same[i] = options.camera ? same_points_along_rays(features, pair, *options.camera, options)
                             : same_points(features, pair, options);
  });
  return same;
}

}  // namespace raysfm
