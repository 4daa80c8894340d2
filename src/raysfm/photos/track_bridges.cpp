#include "raysfm/photos/track_bridges.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "raysfm/core/disjoint_sets.h"
#include "raysfm/places/place_index.h"
#include "raysfm/places/place_matcher.h"
#include "raysfm/projective/view_pair.h"

namespace raysfm {
namespace {

constexpr double kTied = 0.3;  // of the points of one of two images, which the other sees too
constexpr int kFollowers = 4;  // images after one that it is compared with, and so many that look like it
constexpr int kMostAlikePlaces = 6;
constexpr double kProminentVotes = 5;  // standard deviations above what chance gives
constexpr float kMaxDescriptorRatio = 0.85F;
constexpr int kBridgeSamples = 500, kBridgeSample = 8;
constexpr int kLeastAgreeing = 20;
constexpr double kSureBridge = -12;  // logarithm to base 10 of the false alarms
constexpr int kCells = 24;           // across the image: what agrees within one counts once

// A pair of described images, by their places in the list.
using Pair = std::pair<int, int>;

// How many points of each described image the one of number `of` sees; what it shares with itself is all.
class SharedPoints {
 public:
  SharedPoints(const PointTracks& tracks, std::span<const DescribedImage> described)
      : tracks_(tracks), described_(described), observations_(tracks), images_of_(tracks.point_count) {
    std::vector<int> number(tracks.image_count, -1);
    for (size_t j = 0; j < described.size(); ++j) number[described[j].image] = static_cast<int>(j);
    for (int k = 0; k < tracks.size(); ++k) {
      if (number[tracks.image[k]] >= 0) images_of_[tracks.point[k]].push_back(number[tracks.image[k]]);
    }
  }
  int seen_by(int j) const { return observations_.count(described_[j].image); }
  std::vector<int> counts(int of) const {
    std::vector<int> shared(described_.size(), 0);
    const int image = described_[of].image;
    for (const int* k = observations_.begin(image); k != observations_.end(image); ++k) {
      for (const int j : images_of_[tracks_.point[*k]]) ++shared[j];
    }
    return shared;
  }

 private:
  const PointTracks& tracks_;
  const std::span<const DescribedImage> described_;
  const ImageObservations observations_;
  std::vector<std::vector<int>> images_of_;  // of each point, as numbers of described images
};

// Images that one need not be compared with: itself, and those that many tracks tie to it.
std::vector<uint8_t> tied_to(const SharedPoints& points, int of) {
  const std::vector<int> shared = points.counts(of);
  std::vector<uint8_t> tied;
  for (int j = 0; j < static_cast<int>(shared.size()); ++j) {
    tied.push_back(j == of || shared[j] > kTied * std::min(points.seen_by(of), points.seen_by(j)));
  }
  return tied;
}

std::vector<Pair> likely_pairs(const PointTracks& tracks, std::span<const DescribedImage> described,
                               std::span<const uint8_t> is_posed, ThreadPool* pool) {
  const SharedPoints points(tracks, described);
  PlaceIndex index;
  for (const DescribedImage& image : described) index.add(image.descriptors);
  const int count = static_cast<int>(described.size());
  const auto posed = [&](int j) { return !is_posed.empty() && is_posed[described[j].image]; };
  std::vector<std::vector<Pair>> of_image(count);
  pool->parallel_for(count, [&](int j) {
    std::vector<uint8_t> skip = tied_to(points, j);
    for (int i = 0; i < count; ++i) skip[i] = skip[i] || (posed(i) && posed(j));
    for (int i = j + 1; i <= std::min(j + kFollowers, count - 1); ++i) {
      if (!skip[i]) of_image[j].emplace_back(j, i);
    }
    for (const PlaceVotes& v : index.search(described[j].descriptors, skip, kMostAlikePlaces)) {
      if (v.votes < v.by_chance + kProminentVotes * std::sqrt(v.by_chance)) continue;
      of_image[j].push_back(std::minmax(j, v.place));
    }
  });
  std::vector<Pair> pairs;
  for (const auto& some : of_image) pairs.insert(pairs.end(), some.begin(), some.end());
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

// Numbers of the matches that agree with one epipolar geometry; none where that may be by chance.
std::vector<int> agreeing_matches(const PairMatches& matches, const Eigen::Vector2d& image_size,
                                  double max_error_px, uint64_t seed, uint64_t stream,
                                  double* log10_false_alarms) {
  std::vector<int> agreeing;
  ViewPair pair;
  if (std::ssize(matches.a) < kLeastAgreeing) return agreeing;
  if (!fundamental_ransac(matches, max_error_px, kBridgeSamples, seed, stream, &pair)) return agreeing;
  if (pair.inliers < kLeastAgreeing) return agreeing;
  *log10_false_alarms =
      log10_chance_poses(static_cast<int>(matches.a.size()), cells_agreeing(pair, image_size.x()),
                         chance_of_agreement(image_size, max_error_px), kBridgeSample);
  if (*log10_false_alarms > kSureBridge) return agreeing;
  for (size_t m = 0; m < pair.inlier.size(); ++m) {
    if (pair.inlier[m]) agreeing.push_back(static_cast<int>(m));
  }
  return agreeing;
}

}  // namespace

std::vector<TrackBridge> find_bridges(const PointTracks& tracks, std::span<const DescribedImage> described,
                                      std::span<const uint8_t> is_posed, double max_error_px, uint64_t seed,
                                      const std::atomic<bool>* stop, ThreadPool* pool) {
  const std::vector<Pair> pairs = likely_pairs(tracks, described, is_posed, pool);
  const std::vector<std::vector<Eigen::Vector2d>> pixels = pixels_of(tracks, described);
  std::vector<TrackBridge> bridges(pairs.size());
  pool->parallel_for(static_cast<int>(pairs.size()), [&](int i) {
    if (stop && stop->load()) return;
    const auto [a, b] = pairs[i];
    std::vector<DescriptorMatch> alike;
    match_descriptors(described[a].descriptors, described[b].descriptors, kMaxDescriptorRatio, &alike);
    PairMatches matches;
    for (size_t m = 0; m < alike.size(); ++m) {
      matches.points.push_back(static_cast<int>(m));
      matches.a.push_back(pixels[a][alike[m].query]);
      matches.b.push_back(pixels[b][alike[m].train]);
    }
    TrackBridge& bridge = bridges[i];
    bridge.images[0] = described[a].image, bridge.images[1] = described[b].image;
    const uint64_t stream = (uint64_t{static_cast<uint32_t>(a)} << 32) + static_cast<uint32_t>(b);
    for (const int m : agreeing_matches(matches, tracks.image_size, max_error_px, seed, stream,
                                        &bridge.log10_false_alarms)) {
      bridge.same.emplace_back(described[a].points[alike[m].query], described[b].points[alike[m].train]);
    }
  });
  std::erase_if(bridges, [](const TrackBridge& bridge) { return bridge.same.empty(); });
  if (stop && stop->load()) bridges.clear();
  return bridges;
}

std::vector<int> join_points(std::span<const TrackBridge> bridges, PointTracks* tracks) {
  DisjointSets sets(tracks->point_count);
  std::vector<std::vector<int>> seen_in(tracks->point_count);  // images, ascending
  for (int k = 0; k < tracks->size(); ++k) seen_in[tracks->point[k]].push_back(tracks->image[k]);
  for (std::vector<int>& images : seen_in) std::ranges::sort(images);

  std::vector<const TrackBridge*> surest;
  for (const TrackBridge& bridge : bridges) surest.push_back(&bridge);
  std::ranges::stable_sort(surest, {}, &TrackBridge::log10_false_alarms);
  std::vector<int> both;
  for (const TrackBridge* bridge : surest) {
    for (const auto& [in_a, in_b] : bridge->same) {
      const int a = std::min(sets.root(in_a), sets.root(in_b));
      const int b = std::max(sets.root(in_a), sets.root(in_b));
      if (a == b) continue;
      both.clear();
      std::ranges::merge(seen_in[a], seen_in[b], std::back_inserter(both));
      if (std::ranges::adjacent_find(both) != both.end()) continue;
      seen_in[a] = both;
      seen_in[b].clear();
      sets.join(a, b);
    }
  }
  std::vector<int> number(tracks->point_count, -1);
  int count = 0;
  for (int i = 0; i < tracks->point_count; ++i)
    number[i] = sets.root(i) == i ? count++ : number[sets.root(i)];
  for (int& point : tracks->point) point = number[point];
  tracks->point_count = count;
  return number;
}

}  // namespace raysfm
