#include "raysfm/ray_lenses/photos_of_one_lens.h"

#include <algorithm>
#include <utility>
#include <vector>

namespace raysfm {
namespace {

// As parts of the larger side of the image: 45, 67, 29 and 19 degrees.
constexpr double kFocals[] = {1.2, 0.75, 1.9, 3.0};

int agreeing(const RayReconstruction& r) {
  return static_cast<int>(std::ranges::count(r.inlier, 1));
}

}  // namespace

RayReconstruction reconstruct_photos_of_one_lens(const PointTracks& tracks, double focal, int enough,
                                                 const RayOptions& options) {
  std::vector<double> focals;
  if (focal > 0) focals.push_back(focal);
  for (const double part : kFocals) focals.push_back(part * tracks.image_size.maxCoeff());
  RayReconstruction best;
  for (const double guess : focals) {
    if (options.stopped && options.stopped()) break;
    Camera camera;
    camera.model = Radtan{guess, guess, tracks.centre().x(), tracks.centre().y()};
    camera.width = static_cast<int>(tracks.image_size.x());
    camera.height = static_cast<int>(tracks.image_size.y());
    RayReconstruction found = reconstruct_along_rays(tracks, camera, options);
    const bool is_better =
        found.posed != best.posed ? found.posed > best.posed : agreeing(found) > agreeing(best);
    if (is_better) best = std::move(found);
    if (best.posed == tracks.image_count && agreeing(best) > enough) break;
  }
  return best;
}

}  // namespace raysfm
