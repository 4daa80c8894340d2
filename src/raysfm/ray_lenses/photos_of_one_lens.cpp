#include "raysfm/ray_lenses/photos_of_one_lens.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace raysfm {
namespace {

// As parts of the larger side of the image: 45, 29, 67 and 19 degrees.
constexpr double kFocals[] = {1.2, 1.9, 0.75, 3.0};
// Of what is seen: 0.71 to 1 of right reconstructions, of 24 sets, up to 0.29 of wrong ones.
constexpr double kLeastAgreeing = 0.5;
constexpr double kSameFocal = 0.01, kAboutAsMany = 0.9;

int agreeing(const RayReconstruction& r) {
  return static_cast<int>(std::ranges::count(r.inlier, 1));
}

double focal_of(const RayReconstruction& r) {
  return std::get<Radtan>(r.camera.model).fx;
}

bool are_alike(const RayReconstruction& a, const RayReconstruction& b) {
  const auto [fewer, more] = std::minmax(a.posed, b.posed);
  return fewer >= kAboutAsMany * more && std::abs(std::log(focal_of(a) / focal_of(b))) < kSameFocal;
}

RayReconstruction from_guess(const PointTracks& tracks, double focal, const RayOptions& options) {
  Camera camera;
  camera.model = Radtan{focal, focal, tracks.centre().x(), tracks.centre().y()};
  camera.width = static_cast<int>(tracks.image_size.x());
  camera.height = static_cast<int>(tracks.image_size.y());
  return reconstruct_along_rays(tracks, camera, options);
}

}  // namespace

RayReconstruction reconstruct_photos_of_one_lens(const PointTracks& tracks, double focal,
                                                 const RayOptions& options) {
  std::vector<double> focals;
  if (focal > 0) focals.push_back(focal);
  for (const double part : kFocals) focals.push_back(part * tracks.image_size.maxCoeff());
  std::vector<RayReconstruction> all;
  for (const double guess : focals) {
    if (options.stopped && options.stopped()) break;
    RayReconstruction found = from_guess(tracks, guess, options);
    if (found.posed == 0 || agreeing_share(tracks, found) < kLeastAgreeing) continue;
    const bool is_found_twice =
        std::ranges::any_of(all, [&](const RayReconstruction& other) { return are_alike(found, other); });
    all.push_back(std::move(found));
    if (is_found_twice) break;
  }
  if (all.empty()) return {};
  return std::move(*std::ranges::max_element(
      all, {}, [](const RayReconstruction& r) { return std::pair(r.posed, agreeing(r)); }));
}

}  // namespace raysfm
