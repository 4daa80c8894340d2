#include "raysfm/lenses/point_tracks.h"

#include <algorithm>
#include <numeric>

namespace raysfm {
namespace {

std::string observation(size_t k) {
  return "point tracks: observation " + std::to_string(k);
}

Result<void> check_index(size_t k, const char* field, int value, int count) {
  if (value >= 0 && value < count) return {};
  return bad_input(observation(k) + ": " + field + " " + std::to_string(value) + ", allowed 0 to " +
                   std::to_string(count - 1));
}

}  // namespace

Result<void> validate(const PointTracks& tracks) {
  const size_t count = tracks.image.size();
  if (tracks.point.size() != count || tracks.pixel.size() != count) {
    return bad_input("point tracks: " + std::to_string(count) + " images, " +
                     std::to_string(tracks.point.size()) + " points and " +
                     std::to_string(tracks.pixel.size()) + " pixels, must be as many");
  }
  if (tracks.image_count < 1 || tracks.point_count < 1) {
    return bad_input("point tracks: no image or no point, at least one of each is needed");
  }
  if (!(tracks.image_size.array() > 0).all() || !tracks.image_size.allFinite()) {
    return bad_input("point tracks: image_size must be two numbers above 0");
  }
  for (size_t k = 0; k < count; ++k) {
    if (auto in_range = check_index(k, "image", tracks.image[k], tracks.image_count); !in_range)
      return in_range;
    if (auto in_range = check_index(k, "point", tracks.point[k], tracks.point_count); !in_range)
      return in_range;
    if (!tracks.pixel[k].allFinite()) return bad_input(observation(k) + ": pixel must be two finite numbers");
  }
  std::vector<int> order(count);
  std::iota(order.begin(), order.end(), 0);
  const auto key = [&](int k) { return std::pair(tracks.image[k], tracks.point[k]); };
  std::sort(order.begin(), order.end(), [&](int a, int b) { return key(a) < key(b); });
  for (size_t i = 1; i < count; ++i) {
    if (key(order[i]) != key(order[i - 1])) continue;
    return bad_input(observation(std::max(order[i], order[i - 1])) + ": image " +
                     std::to_string(tracks.image[order[i]]) + ", point " +
                     std::to_string(tracks.point[order[i]]) + " again, allowed once");
  }
  return {};
}

PointTracks seen_by(const PointTracks& tracks, std::span<const uint8_t> images, int least,
                    std::vector<int>* observations) {
  std::vector<int> seen(tracks.point_count, 0);
  for (int k = 0; k < tracks.size(); ++k) seen[tracks.point[k]] += images[tracks.image[k]];
  PointTracks part;
  part.image_count = tracks.image_count;
  part.point_count = tracks.point_count;
  part.image_size = tracks.image_size;
  for (int k = 0; k < tracks.size(); ++k) {
    if (!images[tracks.image[k]] || seen[tracks.point[k]] < least) continue;
    part.add(tracks.image[k], tracks.point[k], tracks.pixel[k]);
    if (observations) observations->push_back(k);
  }
  return part;
}

void renumber_points(std::span<const int> number, int count, std::vector<Eigen::Vector3d>* points,
                     std::vector<uint8_t>* placed) {
  std::vector<Eigen::Vector3d> now(count, Eigen::Vector3d::Zero());
  std::vector<uint8_t> placed_now(count, 0);
  for (size_t i = 0; i < number.size(); ++i) {
    if (!(*placed)[i] || number[i] < 0 || placed_now[number[i]]) continue;
    now[number[i]] = (*points)[i];
    placed_now[number[i]] = 1;
  }
  *points = std::move(now);
  *placed = std::move(placed_now);
}

}  // namespace raysfm
