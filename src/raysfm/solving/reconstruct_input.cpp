#include "raysfm/solving/reconstruct_input.h"

#include <algorithm>
#include <string>

#include "raysfm/core/thread_pool.h"
#include "raysfm/photos/photo_lenses.h"
#include "raysfm/photos/photo_pairs.h"
#include "raysfm/results/tracks_file.h"
#include "raysfm/solving/solve_photos.h"
#include "raysfm/uncalibrated/known_structure.h"
#include "raysfm/uncalibrated/video_reconstruct.h"

namespace raysfm {
namespace {

// Photos may see one another in any order; images of a video see their neighbours.
Result<UncalibratedReconstruction> reconstruct_with(const SolveInput& input, const SolveSettings& settings,
                                                    SolveOptions options,
                                                    const UncalibratedReconstruction* start,
                                                    const SolveCallbacks& callbacks) {
  if (!input.structure.empty()) return reconstruct_known(input.tracks, input.structure, options);
  const bool all = std::ranges::count(input.keyframe, 1) == std::ssize(input.keyframe);
  const bool compared = !input.in_order || (all && input.tracks.image_count <= kFewImages);
  const bool photos = compared && !is_tracks_file(settings.input);
  if (photos) options.errors = ErrorRelation::kWithinImages;
  const bool many = photos && input.tracks.image_count > kMostInAllPairs;
  if (photos) options.lens_of_image = input.lens_of_image;
  const bool goes_on = start && !input.in_order;
  if (compared && !many && !goes_on) return reconstruct(input.tracks, options);
  if (goes_on) options.lens = start->zooming ? LensChange::kZoom : LensChange::kFixed;
  VideoOptions video{.in_order = !many && !goes_on, .start = start, .progress = {}, .stop = callbacks.stop};
  if (callbacks.progress) {
    video.progress = [&](int posed, int keyframes) { callbacks.progress("key frame", posed, keyframes); };
  }
  return reconstruct_video(input.tracks, input.keyframe, options, video);
}

// Why what was found contradicts a focal length that is said of all photos; empty where it does not.
std::string contradiction_with(const ExifLens& said, const Result<UncalibratedReconstruction>& found) {
  if (!found) return "nothing agrees with it: " + found.error().message;
  if (found->zooming) return "contradicted by the photos, which have different focal lengths";
  const int image = found->first_posed();
  if (image < 0) return {};
  return contradiction(said, found->scene.lenses[image].fx);
}

}  // namespace

SolveOptions solve_options(const SolveSettings& settings, const std::atomic<bool>* stop) {
  SolveOptions options;
  if (settings.lens == "fixed") options.lens = LensChange::kFixed;
  if (settings.lens == "zoom") options.lens = LensChange::kZoom;
  if (settings.method == "intrinsics-free") options.method = LensMethod::kIntrinsicsFree;
  if (settings.method == "standard") options.method = LensMethod::kStandard;
  if (settings.constraints == "lagrange") options.constraints = ConstraintMethod::kLagrange;
  if (settings.distortion == "none") options.radial = RadialChoice::kNone;
  if (settings.distortion == "radial") options.radial = RadialChoice::kFree;
  options.max_error_px = settings.max_error;
  options.seed = settings.seed;
  options.threads = thread_count(settings.threads);
  if (stop) options.go_on = [stop](const IterationInfo&) { return !stop->load(); };
  return options;
}

Result<UncalibratedReconstruction> reconstruct_input(SolveInput* input, const SolveSettings& settings,
                                                     const SolveCallbacks& callbacks,
                                                     const UncalibratedReconstruction* start) {
  const SolveOptions options = solve_options(settings, callbacks.stop);
  ExifLens* said = lens_to_use(&input->exif);
  if (!said) return reconstruct_with(*input, settings, options, start, callbacks);
  SolveOptions with_focal = options;
  with_focal.focal = said->focal_px, with_focal.focal_sigma = said->focal_sigma_px;
  Result<UncalibratedReconstruction> found = reconstruct_with(*input, settings, with_focal, start, callbacks);
  if (callbacks.stopped()) return found;
  said->not_used = contradiction_with(*said, found);
  if (said->not_used.empty()) return found;
  tell_exif({said, 1}, callbacks.event);
  return reconstruct_with(*input, settings, options, start, callbacks);
}

double reached_share(const Result<UncalibratedReconstruction>& found) {
  return found ? found->posed_share() : 0;
}

}  // namespace raysfm
