// Three images that a reconstruction along rays starts from.
#include <Eigen/Core>
#include <algorithm>
#include <utility>

#include "raysfm/ray_lenses/ray_growth.h"
#include "raysfm/ray_lenses/threes_in_sight.h"

namespace raysfm {
namespace {

// Of the first image of a start, the points that the last one sees as well: at least so many, and this part.
constexpr int kLeastShared = 50;
constexpr double kSharedByStart = 0.4;

}  // namespace

// The last image that still shares much with the first, each in between doing so too; -1: there is none.
int RayGrowth::last_of_start(int first) const {
  std::vector<uint8_t> seen(tracks_.point_count, 0);
  for (const int k : of_image_[first]) seen[tracks_.point[k]] = 1;
  const double enough =
      std::max<double>(kLeastShared, kSharedByStart * static_cast<double>(of_image_[first].size()));
  int last = first + 2;
  while (last + 1 < tracks_.image_count) {
    const auto shared =
        std::ranges::count_if(of_image_[last + 1], [&](int k) { return seen[tracks_.point[k]]; });
    if (static_cast<double>(shared) < enough) break;
    ++last;
  }
  return last < tracks_.image_count ? last : -1;
}

// Of three images, the first and the last of which are the farthest apart; `points`: what they see in common.
ThreeViewStart RayGrowth::three_view_start(const std::array<int, 3>& images, std::vector<int>* points) const {
  std::vector<int> seen[2];
  for (int v = 0; v < 2; ++v) {
    seen[v].assign(tracks_.point_count, -1);
    for (const int k : of_image_[images[v]]) {
      if (has_ray_[k]) seen[v][tracks_.point[k]] = k;
    }
  }
  std::vector<Eigen::Vector3d> bearings[3];
  points->clear();
  for (const int k : of_image_[images[2]]) {
    const int point = tracks_.point[k];
    if (!has_ray_[k] || seen[0][point] < 0 || seen[1][point] < 0) continue;
    points->push_back(point);
    bearings[0].push_back(ray_[seen[0][point]]);
    bearings[1].push_back(ray_[seen[1][point]]);
    bearings[2].push_back(ray_[k]);
  }
  ThreeViewOptions options;
  options.max_error = max_error_ / r_.camera.pixels_per_radian();
  options.seed = options_.seed;
  options.stream = static_cast<uint64_t>(images[0]);
  options.searches = 1;  // to a lens that is guessed a better fit means little, and photos have many threes
  return start_from_three_views(bearings[0], bearings[1], bearings[2], options);
}

void RayGrowth::take(const std::array<int, 3>& images, const ThreeViewStart& start,
                     std::span<const int> points) {
  const Rigid3 cam_from_first[3] = {Rigid3{}, start.cam1_from_cam0, start.cam2_from_cam0};
  for (int v = 0; v < 3; ++v) {
    r_.cam_from_world[images[v]] = cam_from_first[v];
    r_.image_posed[images[v]] = 1;
  }
  for (size_t i = 0; i < points.size(); ++i) {
    r_.points[points[i]] = start.points_in_cam0[i];
    r_.point_placed[points[i]] = start.inlier[i];
  }
  r_.posed = 3;
  r_.start_images = images;
  r_.start_inliers = start.inlier_count;
  adjust();
}

bool RayGrowth::start_along_video() {
  constexpr int kEighths[] = {0, 2, 4, 6, 1, 3, 5};
  std::vector<int> points;
  for (const int e : kEighths) {
    const int first = e * tracks_.image_count / 8, last = last_of_start(first);
    if (last < 0) continue;
    const std::array<int, 3> images = {first, (first + last) / 2, last};
    const ThreeViewStart start = three_view_start(images, &points);
    if (!start.ok()) continue;
    take(images, start, points);
    return true;
  }
  return false;
}

// Of many threes of images that see much in common, the one that tells most points well.
bool RayGrowth::start_anywhere(std::span<const uint8_t> avoided) {
  constexpr double kGoodParallax = 0.15;  // radians; more makes a start no better
  double best = 0;
  std::array<int, 3> best_images = {};
  ThreeViewStart best_start;
  std::vector<int> points, best_points;
  for (const std::array<int, 3>& images : threes_in_sight(tracks_, of_image_)) {
    if (stopped()) break;
    if (std::ranges::count_if(images, [&](int j) { return avoided[j] != 0; }) > 1) continue;
    ThreeViewStart start = three_view_start(images, &points);
    const double worth = start.inlier_count * std::min(1.0, start.median_parallax / kGoodParallax);
    if (!start.ok() || worth <= best) continue;
    best = worth;
    best_images = images;
    best_start = std::move(start);
    best_points = points;
  }
  if (best > 0) take(best_images, best_start, best_points);
  return best > 0;
}

bool RayGrowth::start(std::span<const uint8_t> avoided) {
  return options_.in_order ? start_along_video() : start_anywhere(avoided);
}

void RayGrowth::go_on_from(const RayReconstruction& start) {
  r_ = start;
  r_.inlier.assign(tracks_.size(), 0);
}

}  // namespace raysfm
