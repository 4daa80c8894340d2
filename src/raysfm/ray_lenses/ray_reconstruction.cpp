#include "raysfm/ray_lenses/ray_reconstruction.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "raysfm/ray_lenses/ray_growth.h"

namespace raysfm {
namespace {

constexpr int kStarts = 4;  // of photos, while they lead to no more than most of them
constexpr double kMost = 0.8;

}  // namespace

double agreeing_share(const PointTracks& tracks, const RayReconstruction& r) {
  std::vector<int> seen(tracks.point_count, 0);
  for (int k = 0; k < tracks.size(); ++k) seen[tracks.point[k]] += r.image_posed[tracks.image[k]];
  int all = 0, agreeing = 0;
  for (int k = 0; k < tracks.size(); ++k) {
    if (!r.image_posed[tracks.image[k]] || seen[tracks.point[k]] < 2) continue;
    ++all;
    agreeing += r.inlier[k];
  }
  return all > 0 ? agreeing / double(all) : 0;
}

RayReconstruction reconstruct_along_rays(const PointTracks& tracks, const Camera& guess,
                                         const RayOptions& options) {
  if (options.start) {
    RayGrowth growth(tracks, guess, options);
    growth.go_on_from(*options.start);
    growth.complete();
    return std::move(growth.result());
  }
  RayReconstruction best;
  std::vector<uint8_t> tried(tracks.image_count, 0);  // as starts, or posed by one
  std::vector<uint8_t> sees(tracks.image_count, 0);
  for (const int image : tracks.image) sees[image] = 1;
  const double most = kMost * static_cast<double>(std::ranges::count(sees, 1));
  for (int i = 0; i < (options.in_order ? 1 : kStarts); ++i) {
    RayGrowth growth(tracks, guess, options);
    const bool started = growth.start(tried);
    if (started) {
      growth.complete();
      growth.take_sigma();
    }
    RayReconstruction& found = growth.result();
    for (int j = 0; j < tracks.image_count; ++j) tried[j] |= found.image_posed[j];
    for (const int j : found.start_images) {
      if (j >= 0) tried[j] = 1;
    }
    if (i == 0 || found.posed > best.posed) best = std::move(found);
    if (!started || best.posed >= most) break;
  }
  return best;
}

bool pixel_residual(const PointTracks& tracks, const RayReconstruction& r, int k, Eigen::Vector2d* residual) {
  const int image = tracks.image[k], point = tracks.point[k];
  Eigen::Vector2d pixel;
  if (!r.image_posed[image] || !r.point_placed[point] ||
      !r.camera.project(r.cam_from_world[image] * r.points[point], &pixel))
    return false;
  *residual = pixel - tracks.pixel[k];
  return true;
}

}  // namespace raysfm
