#include "raysfm/scene/weak_links.h"

#include <algorithm>

#include "raysfm/core/median.h"

namespace raysfm {
namespace {

constexpr int kFew = 50;
constexpr double kFewOfUsual = 0.1;
// To either side of a place, that see a point: one more than tells nothing of a length.
constexpr int kSightings = 2;

// Of a world, by its key frames, which are in the order of their frames: what holds each to the one after it.
std::vector<int> points_across(const Reconstruction& r, const std::vector<int>& keyframes) {
  std::vector<std::vector<int>> seen(r.points.size());
  for (size_t k = 0; k < keyframes.size(); ++k) {
    const KeyFrame& keyframe = r.keyframes[keyframes[k]];
    for (int o = keyframe.first_observation; o < keyframe.last_observation; ++o) {
      std::vector<int>& by = seen[r.observations[o].point];
      if (by.empty() || by.back() != static_cast<int>(k)) by.push_back(static_cast<int>(k));
    }
  }
  std::vector<int> across(keyframes.size(), 0);
  for (const std::vector<int>& by : seen) {
    if (by.size() < 2 * kSightings) continue;
    ++across[by[kSightings - 1]];
    --across[by[by.size() - kSightings]];
  }
  for (size_t k = 1; k < across.size(); ++k) across[k] += across[k - 1];
  return across;
}

void find_in(const Reconstruction& r, const std::vector<int>& keyframes, std::vector<WeakLink>* links) {
  const int places = static_cast<int>(keyframes.size()) - 2 * kSightings + 1;
  if (places < 1) return;
  const std::vector<int> across = points_across(r, keyframes);
  std::vector<int> sorted(across.begin() + kSightings - 1, across.begin() + kSightings - 1 + places);
  const double usual = median_of(&sorted);
  bool goes_on = false;
  for (int k = kSightings - 1; k < kSightings - 1 + places; ++k) {
    const bool is_weak = across[k] < std::min<double>(kFew, kFewOfUsual * usual);
    if (is_weak && !goes_on) links->push_back({r.keyframes[keyframes[k]].frame, 0, across[k], usual});
    if (is_weak) {
      links->back().last = r.keyframes[keyframes[k + 1]].frame;
      links->back().points = std::min(links->back().points, across[k]);
    }
    goes_on = is_weak;
  }
}

}  // namespace

std::vector<WeakLink> weak_links(const Reconstruction& r) {
  std::vector<std::vector<int>> of_segment(r.segments.size());
  for (size_t k = 0; k < r.keyframes.size(); ++k) {
    const int segment = r.frames[r.keyframes[k].frame].segment;
    if (segment >= 0) of_segment[segment].push_back(static_cast<int>(k));
  }
  std::vector<WeakLink> links;
  for (size_t s = 0; s < of_segment.size(); ++s) {
    const auto frame_of = [&](int k) { return r.keyframes[k].frame; };
    std::ranges::sort(of_segment[s], {}, frame_of);
    if (!r.segments[s].metric_scale) find_in(r, of_segment[s], &links);
  }
  std::ranges::sort(links, {}, &WeakLink::first);
  return links;
}

}  // namespace raysfm
