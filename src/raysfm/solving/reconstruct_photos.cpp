#include "raysfm/solving/reconstruct_photos.h"

#include <algorithm>
#include <iterator>
#include <limits>
#include <optional>
#include <span>
#include <utility>

#include "raysfm/photos/photo_lenses.h"
#include "raysfm/photos/photo_points.h"
#include "raysfm/ray_lenses/photos_of_one_lens.h"
#include "raysfm/solving/reconstruct_input.h"
#include "raysfm/solving/solve_photos.h"
#include "raysfm/solving/worlds_left_out.h"
#include "raysfm/uncalibrated/dense_groups.h"
#include "raysfm/uncalibrated/solution.h"
#include "raysfm/uncalibrated/video_reconstruct.h"

namespace raysfm {
namespace {

constexpr double kHalf = 0.5;  // of the photos
constexpr double kAboutAsMany = 0.9;
// Groups of many photos among which a lens is looked for, and photos of each.
constexpr int kGroups = 3, kGroupPhotos = 40;

void mark_inliers(const PointTracks& tracks, double max_error, UncalibratedReconstruction* found) {
  found->inlier = agreeing_observations(tracks, found->scene, found->radial, found->image_posed,
                                        found->point_placed, max_error);
}

// What was found along the rays of one perspective lens.
UncalibratedReconstruction start_from(const RayReconstruction& rays, const PointTracks& tracks,
                                      double max_error) {
  const Radtan& model = std::get<Radtan>(rays.camera.model);
  const Lens lens{model.fx, model.fy, model.cx, model.cy, 0};
  UncalibratedReconstruction start;
  start.scene.cam_from_world = rays.cam_from_world;
  start.scene.points = rays.points;
  start.scene.lenses.assign(tracks.image_count, lens);
  start.radial = {model.k1, model.k2};
  start.image_posed = rays.image_posed;
  start.point_placed = rays.point_placed;
  start.lens_sigma.assign(tracks.image_count, LensVector::Constant(std::numeric_limits<double>::infinity()));
  std::copy_n(rays.start_images.begin(), 2, start.start_images);
  start.start_inliers = rays.start_inliers;
  mark_inliers(tracks, max_error, &start);
  return start;
}

// The same with one lens or one for each photo, as is asked for or as the photos themselves say.
void choose_lenses(const PointTracks& tracks, const SolveSettings& settings, const SolveCallbacks& callbacks,
                   UncalibratedReconstruction* start) {
  start->zooming = settings.lens == "zoom";
  start->lens_evidence = "as asked for";
  if (settings.lens != "auto") return;
  ZoomSigns signs = signs_of_zoom(tracks, start->image_posed, solve_options(settings, callbacks.stop),
                                  ErrorRelation::kWithinImages, *start);
  start->zooming = signs.zooms;
  start->lens_evidence = std::move(signs.evidence);
  start->lens_gain = signs.gain;
  start->lens_spread = signs.spread;
}

// Of many photos a group that sees much of one another.
RayReconstruction start_along_rays(const PointTracks& tracks, double focal, const RayOptions& options) {
  if (tracks.image_count <= kMostInAllPairs) return reconstruct_photos_of_one_lens(tracks, focal, options);
  RayReconstruction best;
  for (const std::vector<int>& group : dense_groups(tracks, kGroupPhotos, kGroups)) {
    std::vector<uint8_t> in_group(tracks.image_count, 0);
    for (const int j : group) in_group[j] = 1;
    RayReconstruction found =
        reconstruct_photos_of_one_lens(seen_by(tracks, in_group, 1, nullptr), focal, options);
    if (found.posed > best.posed) best = std::move(found);
    if (best.posed >= kHalf * static_cast<double>(group.size())) break;
  }
  return best;
}

Result<UncalibratedReconstruction> along_rays(SolveInput* input, const SolveSettings& settings,
                                              const SolveCallbacks& callbacks) {
  const ExifLens* said = lens_to_use(&input->exif);
  const RayReconstruction rays =
      start_along_rays(input->tracks, said ? said->focal_px : 0, ray_options(*input, settings, callbacks));
  if (rays.posed == 0) return no_reconstruction("no three photos start a reconstruction with one lens");
  UncalibratedReconstruction start = start_from(rays, input->tracks, settings.max_error);
  choose_lenses(input->tracks, settings, callbacks, &start);
  return reconstruct_input(input, settings, callbacks, &start);
}

// Whether more photos have a pose. A lens for each photo explains matches that are wrong too: where one lens
// explains some of the photos, it must do for most.
bool is_better(const Result<UncalibratedReconstruction>& found,
               const Result<UncalibratedReconstruction>& before) {
  if (!found || !before) return found.ok();
  if (found->zooming && !before->zooming && reached_share(found) < kGoodShare) return false;
  return reached_share(found) > reached_share(before);
}

// Whether `a` explains what both have in common better than `b`, errors counting no more than the largest
// that is allowed.
bool is_closer(const PointTracks& tracks, double max_error, const UncalibratedReconstruction& a,
               const UncalibratedReconstruction& b) {
  const auto cost = [&](const UncalibratedReconstruction& r, int k) {
    return std::min(max_error * max_error, pixel_residual(tracks, r.scene, r.radial, k).squaredNorm());
  };
  double of_a = 0, of_b = 0;
  for (int k = 0; k < tracks.size(); ++k) {
    const int image = tracks.image[k], point = tracks.point[k];
    if (!a.image_posed[image] || !b.image_posed[image] || !a.point_placed[point] || !b.point_placed[point])
      continue;
    of_a += cost(a, k);
    of_b += cost(b, k);
  }
  return of_a < of_b;
}

// Part of the photos that have a pose, in other worlds too.
double share_in_worlds(const SolveInput& input, const Result<UncalibratedReconstruction>& found,
                       const SolveSettings& settings, const SolveCallbacks& callbacks) {
  if (!found) return 0;
  int posed = found->posed_count();
  for (const RayReconstruction& world : worlds_left_out(input, *found, settings, callbacks))
    posed += world.posed;
  return posed / static_cast<double>(found->image_posed.size());
}

// Of the tracks as they are. Photos that zoom are reconstructed without one lens too: what it has bent of
// them growth does not always bend back.
Result<UncalibratedReconstruction> reconstruct_anew(SolveInput* input, const SolveSettings& settings,
                                                    const SolveCallbacks& callbacks) {
  Result<UncalibratedReconstruction> found = along_rays(input, settings, callbacks);
  const bool zooms = found && found->zooming;
  if (callbacks.stopped()) return found;
  const auto is_good = [&] {
    return reached_share(found) >= kGoodShare ||
           share_in_worlds(*input, found, settings, callbacks) >= kGoodShare;
  };
  if (!zooms && is_good()) return found;
  Result<UncalibratedReconstruction> other = reconstruct_input(input, settings, callbacks);
  const auto [fewer, more] = std::minmax({reached_share(found), reached_share(other)});
  const bool take_other = found && other && zooms && fewer >= kAboutAsMany * more
                              ? is_closer(input->tracks, settings.max_error, *other, *found)
                              : !found || is_better(other, found);
  return take_other ? std::move(other) : std::move(found);
}

// What was found of photos, by the tracks that they have now.
UncalibratedReconstruction start_from(UncalibratedReconstruction found, const SolveInput& before,
                                      const SolveInput& now, double max_error) {
  renumber_points(tracks_now(before.photo_points, now.photo_points), now.tracks.point_count,
                  &found.scene.points, &found.point_placed);
  mark_inliers(now.tracks, max_error, &found);
  return found;
}

// Photos compared by what is less clear too, as if nothing had been found of them.
std::optional<SolveInput> compared_afresh(SolveInput input, const SolveSettings& settings,
                                          const SolveCallbacks& callbacks) {
  input.photo_points.track.clear();
  input.photo_points.tracks = 0;
  const std::vector<uint8_t> none(input.names.size(), 0);
  return with_loose_matches(input, none, settings, callbacks);
}

// The main world of the camera that is given.
RayReconstruction reconstruct_photos_of_camera(SolveInput* input, const SolveSettings& settings,
                                               const SolveCallbacks& callbacks) {
  RayOptions options = ray_options(*input, settings, callbacks);
  options.is_known = true;
  RayReconstruction found = reconstruct_along_rays(input->tracks, *input->camera, options);
  const auto take_if_better = [&](SolveInput loose) {
    RayReconstruction other = reconstruct_along_rays(loose.tracks, *input->camera, options);
    if (other.posed <= found.posed) return;
    *input = std::move(loose);
    found = std::move(other);
  };
  if (found.posed > 0) {
    std::optional<SolveInput> loose = with_loose_matches(*input, found.image_posed, settings, callbacks);
    if (!loose) return found;
    RayReconstruction start = found;
    renumber_points(tracks_now(input->photo_points, loose->photo_points), loose->tracks.point_count,
                    &start.points, &start.point_placed);
    options.start = &start;
    take_if_better(*std::move(loose));
    options.start = nullptr;
  }
  if (found.posed == std::ssize(input->names)) return found;
  if (auto loose = compared_afresh(*input, settings, callbacks)) take_if_better(*std::move(loose));
  return found;
}

}  // namespace

Result<UncalibratedReconstruction> reconstruct_photos(SolveInput* input, const SolveSettings& settings,
                                                      const SolveCallbacks& callbacks) {
  Result<UncalibratedReconstruction> found = reconstruct_anew(input, settings, callbacks);
  const auto take_if_better = [&](SolveInput loose, const UncalibratedReconstruction* start) {
    Result<UncalibratedReconstruction> other = start ? reconstruct_input(&loose, settings, callbacks, start)
                                                     : reconstruct_anew(&loose, settings, callbacks);
    if (!is_better(other, found)) return;
    *input = std::move(loose);
    found = std::move(other);
  };
  if (found) {
    if (auto loose = with_loose_matches(*input, found->image_posed, settings, callbacks)) {
      const UncalibratedReconstruction start = start_from(*found, *input, *loose, settings.max_error);
      take_if_better(*std::move(loose), &start);
    }
  }
  if (reached_share(found) < kGoodShare) {
    if (auto loose = compared_afresh(*input, settings, callbacks)) take_if_better(*std::move(loose), nullptr);
  }
  return found;
}

std::vector<RayReconstruction> reconstruct_worlds_of_camera(SolveInput* input, const SolveSettings& settings,
                                                            const SolveCallbacks& callbacks) {
  std::vector<RayReconstruction> worlds = {reconstruct_photos_of_camera(input, settings, callbacks)};
  if (worlds[0].posed == 0) return {};
  auto others = worlds_left_out(*input, worlds[0].image_posed, *input->camera, settings, callbacks);
  std::ranges::move(others, std::back_inserter(worlds));
  return worlds;
}

}  // namespace raysfm
