#include "raysfm/photos/track_bridges.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>

#include "raysfm/places/place_index.h"
#include "raysfm/places/place_matcher.h"
#include "raysfm/projective/view_pair.h"

namespace raysfm {
namespace {

constexpr int kFewShared = 20;  // points: images that share fewer are of two stretches
constexpr int kLooksBack = 3;   // images before one that may share points with it
constexpr int kMostAlikePlaces = 6;  // that an image is compared with
constexpr double kProminentVotes = 5;  // standard deviations above what chance gives
constexpr int kAtEnds = 3;           // images of a stretch that are compared with as many of the next
constexpr float kMaxDescriptorRatio = 0.85F;
constexpr int kBridgeSamples = 1000, kBridgeSample = 8;
constexpr int kLeastAgreeing = 20;
constexpr double kSureBridge = -12;  // logarithm to base 10 of the false alarms
constexpr int kCells = 24;           // across the image: what agrees within one counts once

// A pair of described images, by their places in the list.
using Pair = std::pair<int, int>;

void add_ends(std::span<const int> stretch, std::vector<Pair>* pairs) {
  for (size_t b = 1; b < stretch.size(); ++b) {
    if (stretch[b] == stretch[b - 1]) continue;
    for (size_t i = b; i < std::min(b + kAtEnds, stretch.size()) && stretch[i] == stretch[b]; ++i) {
      for (size_t a = b; a-- > 0 && a + kAtEnds >= b && stretch[a] == stretch[b - 1];) {
        pairs->emplace_back(a, i);
      }
    }
  }
}

std::vector<Pair> likely_pairs(std::span<const DescribedImage> described, std::span<const int> stretch,
                               ThreadPool* pool) {
  PlaceIndex index;
  for (const DescribedImage& image : described) index.add(image.descriptors);
  std::vector<std::vector<Pair>> of_image(described.size());
  pool->parallel_for(static_cast<int>(described.size()), [&](int j) {
    std::vector<uint8_t> skip;
    for (const int other : stretch) skip.push_back(other == stretch[j]);
    for (const PlaceVotes& v : index.search(described[j].descriptors, skip, kMostAlikePlaces)) {
      if (v.votes < v.by_chance + kProminentVotes * std::sqrt(v.by_chance)) continue;
      of_image[j].push_back(std::minmax(j, v.place));
    }
  });
  std::vector<Pair> pairs;
  for (const auto& some : of_image) pairs.insert(pairs.end(), some.begin(), some.end());
  add_ends(stretch, &pairs);
  std::ranges::sort(pairs);
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  return pairs;
}

// Where the tracks have the points of an image.
std::vector<std::vector<Eigen::Vector2d>> pixels_of(const PointTracks& tracks,
                                                    std::span<const DescribedImage> described) {
  const ImageObservations observations(tracks);
  std::vector<std::vector<Eigen::Vector2d>> pixels(described.size());
  for (size_t j = 0; j < described.size(); ++j) {
    const int* k = observations.begin(described[j].image);
    for (const int point : described[j].points) {
      while (tracks.point[*k] < point) ++k;
      pixels[j].push_back(tracks.pixel[*k]);
    }
  }
  return pixels;
}

// Agreement in one cell of the first image counts once.
int cells_agreeing(const ViewPair& pair, double image_width) {
  const double side = image_width / kCells;
  std::set<std::pair<int, int>> cells;
  for (size_t i = 0; i < pair.inlier.size(); ++i) {
    if (!pair.inlier[i]) continue;
    cells.emplace(static_cast<int>(pair.matches.a[i].x() / side),
                  static_cast<int>(pair.matches.a[i].y() / side));
  }
  return static_cast<int>(cells.size());
}

// Of a match anywhere in the image to lie as near to its epipolar line as agreement asks for.
double chance_of_agreement(const Eigen::Vector2d& image_size, double max_error_px) {
  return std::min(0.5, 2 * max_error_px * image_size.norm() / image_size.prod());
}

}  // namespace

std::vector<int> stretches_of(const PointTracks& tracks, std::span<const int> images) {
  const ImageObservations observations(tracks);
  std::vector<int> stretch(images.size(), 0);
  for (size_t j = 1; j < images.size(); ++j) {
    bool goes_on = false;
    for (size_t d = 1; d <= std::min<size_t>(j, kLooksBack) && !goes_on; ++d) {
      goes_on = stretch[j - d] == stretch[j - 1] &&
                std::ssize(observations.matches(images[j - d], images[j]).points) >= kFewShared;
    }
    stretch[j] = stretch[j - 1] + (goes_on ? 0 : 1);
  }
  return stretch;
}

std::vector<TrackBridge> find_bridges(const PointTracks& tracks, std::span<const DescribedImage> described,
                                      double max_error_px, uint64_t seed, const std::atomic<bool>* stop,
                                      ThreadPool* pool) {
  std::vector<int> images;
  for (const DescribedImage& image : described) images.push_back(image.image);
  const std::vector<int> stretch = stretches_of(tracks, images);
  if (stretch.empty() || stretch.back() == 0) return {};
  const std::vector<Pair> pairs = likely_pairs(described, stretch, pool);
  const std::vector<std::vector<Eigen::Vector2d>> pixels = pixels_of(tracks, described);
  const double chance = chance_of_agreement(tracks.image_size, max_error_px);
  std::vector<TrackBridge> bridges(pairs.size());
  pool->parallel_for(static_cast<int>(pairs.size()), [&](int i) {
    if (stop && stop->load()) return;
    const auto [a, b] = pairs[i];
    std::vector<DescriptorMatch> alike;
    match_descriptors(described[a].descriptors, described[b].descriptors, kMaxDescriptorRatio, &alike);
    if (std::ssize(alike) < kLeastAgreeing) return;
    PairMatches matches;
    for (size_t m = 0; m < alike.size(); ++m) {
      matches.points.push_back(static_cast<int>(m));
      matches.a.push_back(pixels[a][alike[m].query]);
      matches.b.push_back(pixels[b][alike[m].train]);
    }
    ViewPair pair;
    const uint64_t stream = (uint64_t{static_cast<uint32_t>(a)} << 32) + static_cast<uint32_t>(b);
    if (!fundamental_ransac(matches, max_error_px, kBridgeSamples, seed, stream, &pair)) return;
    TrackBridge& bridge = bridges[i];
    bridge.images[0] = images[a], bridge.images[1] = images[b];
    bridge.log10_false_alarms =
        log10_chance_poses(static_cast<int>(alike.size()), cells_agreeing(pair, tracks.image_size.x()),
                           chance, kBridgeSample);
    if (pair.inliers < kLeastAgreeing || bridge.log10_false_alarms > kSureBridge) return;
    for (size_t m = 0; m < alike.size(); ++m) {
      if (!pair.inlier[m]) continue;
      bridge.same.emplace_back(described[a].points[alike[m].query], described[b].points[alike[m].train]);
    }
  });
  std::erase_if(bridges, [](const TrackBridge& bridge) { return bridge.same.empty(); });
  if (stop && stop->load()) bridges.clear();
  return bridges;
}

std::vector<int> join_points(std::span<const TrackBridge> bridges, PointTracks* tracks) {
  std::vector<int> parent(tracks->point_count);
  std::iota(parent.begin(), parent.end(), 0);
  const auto root = [&](int i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
  };
  std::vector<std::vector<int>> seen_in(tracks->point_count);  // images, ascending
  for (int k = 0; k < tracks->size(); ++k) seen_in[tracks->point[k]].push_back(tracks->image[k]);
  for (std::vector<int>& images : seen_in) std::ranges::sort(images);

  std::vector<const TrackBridge*> surest;
  for (const TrackBridge& bridge : bridges) surest.push_back(&bridge);
  std::ranges::stable_sort(surest, {}, &TrackBridge::log10_false_alarms);
  std::vector<int> both;
  for (const TrackBridge* bridge : surest) {
    for (const auto& [in_a, in_b] : bridge->same) {
      const int a = std::min(root(in_a), root(in_b)), b = std::max(root(in_a), root(in_b));
      if (a == b) continue;
      both.clear();
      std::ranges::merge(seen_in[a], seen_in[b], std::back_inserter(both));
      if (std::ranges::adjacent_find(both) != both.end()) continue;
      seen_in[a] = both;
      seen_in[b].clear();
      parent[b] = a;
    }
  }
  std::vector<int> number(tracks->point_count, -1);
  int count = 0;
  for (int i = 0; i < tracks->point_count; ++i) number[i] = root(i) == i ? count++ : number[root(i)];
  for (int& point : tracks->point) point = number[point];
  tracks->point_count = count;
  return number;
}

}  // namespace raysfm
