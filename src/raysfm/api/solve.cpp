#include "raysfm/api/solve.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "raysfm/api/find_lens.h"
#include "raysfm/api/solve_by_tracking.h"
#include "raysfm/api/solve_result.h"
#include "raysfm/core/memory.h"
#include "raysfm/core/thread_pool.h"
#include "raysfm/core/timer.h"
#include "raysfm/photos/photo_lenses.h"
#include "raysfm/photos/photo_pairs.h"
#include "raysfm/ray_lenses/photos_of_one_lens.h"
#include "raysfm/ray_lenses/ray_reconstruction.h"
#include "raysfm/results/tracks_file.h"
#include "raysfm/scene/worlds.h"
#include "raysfm/solving/joined_stretches.h"
#include "raysfm/solving/solve_input.h"
#include "raysfm/solving/solve_photos.h"
#include "raysfm/solving/solve_tracks.h"
#include "raysfm/uncalibrated/known_structure.h"
#include "raysfm/uncalibrated/lens_choice.h"
#include "raysfm/uncalibrated/solution.h"
#include "raysfm/uncalibrated/video_reconstruct.h"

namespace raysfm {
namespace {

constexpr double kGoodShare = 0.8;  // of the images, with a pose

SolveOptions options_of(const SolveSettings& settings, const std::atomic<bool>* stop) {
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

Result<SolveInput> read_input(const SolveSettings& settings, const SolveCallbacks& callbacks) {
  if (is_tracks_file(settings.input)) return tracks_from_file(settings, callbacks);
  return tracks_from_images(settings, callbacks);
}

// Images that only repeat others have their poses and lenses.
void pose_repeats(const SolveInput& input, UncalibratedReconstruction* found) {
  for (int j = 0; j < static_cast<int>(input.names.size()); ++j) {
    const int original = input.original(j);
    if (original == j) continue;
    found->image_posed[j] = found->image_posed[original];
    found->scene.cam_from_world[j] = found->scene.cam_from_world[original];
    found->scene.lenses[j] = found->scene.lenses[original];
    if (!found->lens_sigma.empty()) found->lens_sigma[j] = found->lens_sigma[original];
  }
}

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

// With the focal length that all photos are said to have, if it holds. `start`: see VideoOptions.
Result<UncalibratedReconstruction> reconstruct_input(SolveInput* input, const SolveSettings& settings,
                                                     const SolveCallbacks& callbacks,
                                                     const UncalibratedReconstruction* start = nullptr) {
  const SolveOptions options = options_of(settings, callbacks.stop);
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

// 0 without a reconstruction.
double reached_share(const Result<UncalibratedReconstruction>& found) {
  return found ? found->posed_share() : 0;
}

void warn_of_lens(const EventSink& event, SolveResult* solved) {
  const SolveResult& result = *solved;
  if (!result.report.lens->zooming && !result.reconstruction.lenses.empty()) {
    std::string wide = wide_lens_warning(result.reconstruction.lenses[0].camera);
    if (!wide.empty()) wide += "; of a video, raysfm track without a camera file finds fisheyes too";
    tell(event, Event::Level::kWarning, wide);
    if (!wide.empty()) solved->report.warnings.push_back(wide);
  }
  if (!result.report.lens->degenerate.empty()) {
    tell(event, Event::Level::kWarning,
         fmt::format("the focal lengths are not determined by these images: {}",
                     result.report.lens->degenerate));
  }
}

void warn(const EventSink& event, SolveResult* solved) {
  const SolveResult& result = *solved;
  if (result.report.lens) warn_of_lens(event, solved);
  const size_t frames = result.reconstruction.frames.size();
  const size_t lost = frames - posed_count(result.reconstruction);
  if (lost > 0) {
    tell(event, Event::Level::kWarning, fmt::format("{} of {} frames have no pose", lost, frames));
  }
}

void set_times(Clock::time_point start, double read_s, SolveResult* result) {
  Report& report = result->report;
  report.wall_s = milliseconds_since(start) / 1000.0;
  if (report.adjustment) {
    report.adjustment->read_s = read_s;
    report.adjustment->solve_s = report.wall_s - read_s;
  }
  report.frames_per_second = static_cast<double>(result->reconstruction.frames.size()) / report.wall_s;
  report.peak_rss_mib = peak_rss_mib();
}

// Images in order that are no few photos.
bool is_video(const SolveSettings& settings, const SolveInput& input) {
  return input.in_order && !is_tracks_file(settings.input) && input.tracks.image_count > kFewImages;
}

// Whether more than a few key frames are left out.
bool is_incomplete(const SolveInput& input, const UncalibratedReconstruction& found) {
  constexpr double kMostLeftOut = 0.05;
  int keyframes = 0, left_out = 0;
  for (size_t j = 0; j < input.keyframe.size(); ++j) {
    keyframes += input.keyframe[j];
    left_out += input.keyframe[j] && !found.image_posed[j];
  }
  return left_out > kMostLeftOut * keyframes;
}

int agreeing(const UncalibratedReconstruction& found) {
  return static_cast<int>(std::ranges::count(found.inlier, 1));
}

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

// Whether photos have no good reconstruction with one lens.
bool may_have_one_lens(const SolveInput& input, const SolveSettings& settings,
                       const Result<UncalibratedReconstruction>& found) {
  if (!input.photo_points.features || settings.lens == "zoom") return false;
  return !found || found->zooming || reached_share(found) < kGoodShare;
}

// Photos again, from guesses of one lens: better where more have a pose with it, or about as many and a lens
// for each, which explains false matches too, is no better where both have one.
void reconsider_one_lens(SolveInput* input, const SolveSettings& settings, const SolveCallbacks& callbacks,
                         Result<UncalibratedReconstruction>* found) {
  if (!may_have_one_lens(*input, settings, *found) || callbacks.stopped()) return;
  const RayOptions options{.max_error_px = settings.max_error,
                           .in_order = false,
                           .seed = settings.seed,
                           .threads = thread_count(settings.threads),
                           .stopped = [&callbacks] { return callbacks.stopped(); }};
  const ExifLens* said = lens_to_use(&input->exif);
  const RayReconstruction rays = reconstruct_photos_of_one_lens(input->tracks, said ? said->focal_px : 0,
                                                                *found ? agreeing(**found) : 0, options);
  if (rays.posed == 0 || callbacks.stopped()) return;
  const UncalibratedReconstruction start = start_from(rays, input->tracks, settings.max_error);
  Result<UncalibratedReconstruction> other = reconstruct_input(input, settings, callbacks, &start);
  const double before = reached_share(*found), now = reached_share(other);
  if (*found && (*found)->zooming) {
    if (!(now >= kGoodShare * before)) return;
    const std::vector<uint8_t> all(input->tracks.image_count, 1);
    *found = choose_lens(input->tracks, all, std::move(other), std::move(*found), settings.max_error,
                         ErrorRelation::kWithinImages);
  } else if (now > before) {
    *found = std::move(other);
  }
}

// What was found of photos, by the tracks that they have now.
UncalibratedReconstruction start_from(UncalibratedReconstruction found, const SolveInput& before,
                                      const SolveInput& now, double max_error) {
  renumber_points(tracks_now(before.photo_points, now.photo_points), now.tracks.point_count,
                  &found.scene.points, &found.point_placed);
  mark_inliers(now.tracks, max_error, &found);
  return found;
}

// What may pose images that a reconstruction leaves out, or that there is none of (null).
std::optional<JoinedStretches> joined_further(const SolveInput& input,
                                              const UncalibratedReconstruction* found,
                                              const SolveSettings& settings,
                                              const SolveCallbacks& callbacks) {
  if (!input.photo_points.features) return joined_stretches(input, found, settings, callbacks);
  if (!found) return {};
  std::optional<SolveInput> loose = with_loose_matches(input, found->image_posed, settings, callbacks);
  if (!loose) return {};
  JoinedStretches joined{*std::move(loose), {}};
  joined.start = start_from(*found, input, joined.input, settings.max_error);
  return joined;
}

// Photos compared by what is less clear too, as if nothing had been found of them.
std::optional<JoinedStretches> compared_afresh(SolveInput input, const SolveSettings& settings,
                                               const SolveCallbacks& callbacks) {
  input.photo_points.track.clear();
  input.photo_points.tracks = 0;
  const std::vector<uint8_t> none(input.names.size(), 0);
  std::optional<SolveInput> loose = with_loose_matches(input, none, settings, callbacks);
  if (!loose) return {};
  return JoinedStretches{*std::move(loose), {}};
}

// Where images are left out, the reconstruction of what may pose more, if it does. `input` becomes what the
// reconstruction is of.
void take_if_better(std::optional<JoinedStretches> joined, const SolveSettings& settings,
                    const SolveCallbacks& callbacks, SolveInput* input,
                    Result<UncalibratedReconstruction>* found) {
  if (!joined) return;
  Result<UncalibratedReconstruction> other =
      reconstruct_input(&joined->input, settings, callbacks, joined->start ? &*joined->start : nullptr);
  if (!(reached_share(other) > reached_share(*found))) return;
  // Matches that are less clear make many a lens zoom.
  if (*found && !joined->input.in_order && other->zooming && !(*found)->zooming) return;
  *input = std::move(joined->input);
  *found = std::move(other);
}

// The same, and where that leaves images out again with what joins the stretches of a video, or with more
// matches of photos: to go on from there, and from the start where many are out. `input` becomes what the
// reconstruction is of.
Result<UncalibratedReconstruction> reconstruct_further(SolveInput* input, const SolveSettings& settings,
                                                       const SolveCallbacks& callbacks) {
  Result<UncalibratedReconstruction> found = reconstruct_input(input, settings, callbacks);
  reconsider_one_lens(input, settings, callbacks, &found);
  take_if_better(joined_further(*input, found ? &*found : nullptr, settings, callbacks), settings, callbacks,
                 input, &found);
  if (input->photo_points.features && reached_share(found) < kGoodShare)
    take_if_better(compared_afresh(*input, settings, callbacks), settings, callbacks, input, &found);
  return found;
}

// A few images that do not go well as a video may go better as photos.
Result<void> try_as_photos(const SolveSettings& settings, const SolveCallbacks& callbacks, SolveInput* input,
                           Result<UncalibratedReconstruction>* found) {
  if (settings.images != "auto" || is_tracks_file(settings.input) || !input->in_order ||
      input->tracks.image_count > kFewImages || callbacks.stopped() ||
      !(reached_share(*found) < kGoodShare)) {
    return {};
  }
  tell(callbacks.event, Event::Level::kInfo,
       *found ? "as a video few of the images have a pose, now tried as photos"
              : "not solved as a video, now tried as photos: " + found->error().message);
  Result<SolveInput> photos = tracks_from_photos(settings, callbacks);
  if (!photos) return photos.error();
  Result<UncalibratedReconstruction> other = reconstruct_further(&*photos, settings, callbacks);
  if (reached_share(other) >= reached_share(*found)) {
    *input = *std::move(photos);
    *found = std::move(other);
  }
  return {};
}

// Tracks of a camera that is given, which tells the size of the images.
Result<SolveInput> tracks_of_camera(const SolveSettings& settings, const SolveCallbacks& callbacks) {
  Result<Camera> camera = known_camera(settings, nullptr, callbacks.event);
  if (!camera) return camera.error();
  SolveSettings sized = settings;
  if (sized.size.empty() && camera->width > 0)
    sized.size = fmt::format("{}x{}", camera->width, camera->height);
  Result<SolveInput> input = tracks_from_file(sized, callbacks);
  if (!input) return input;
  const Eigen::Vector2i size = input->tracks.image_size.cast<int>();
  if (camera->width > 0 && Eigen::Vector2i(camera->width, camera->height) != size) {
    return bad_input(fmt::format("--size = '{}': {} is for images of {}x{}", sized.size, settings.camera,
                                 camera->width, camera->height));
  }
  camera->width = size.x(), camera->height = size.y();
  input->camera = *std::move(camera);
  return input;
}

// Where photos are left out, with more matches, to go on from there, and from the start. `input` becomes what
// the reconstruction is of.
void pose_left_photos(const SolveSettings& settings, const SolveCallbacks& callbacks, RayOptions options,
                      SolveInput* input, RayReconstruction* found) {
  const auto take_if_better = [&](SolveInput loose) {
    RayReconstruction other = reconstruct_along_rays(loose.tracks, *input->camera, options);
    if (other.posed <= found->posed) return;
    *input = std::move(loose);
    *found = std::move(other);
  };
  if (found->posed > 0) {
    std::optional<SolveInput> loose = with_loose_matches(*input, found->image_posed, settings, callbacks);
    if (!loose) return;
    RayReconstruction start = *found;
    renumber_points(tracks_now(input->photo_points, loose->photo_points), loose->tracks.point_count,
                    &start.points, &start.point_placed);
    options.start = &start;
    take_if_better(*std::move(loose));
    options.start = nullptr;
  }
  if (found->posed == std::ssize(input->names)) return;
  if (auto afresh = compared_afresh(*input, settings, callbacks)) take_if_better(std::move(afresh->input));
}

// Poses and map of the images of input.camera, adjusted together.
Result<SolveResult> solve_with_camera(SolveInput input, const SolveSettings& settings,
                                      const SolveCallbacks& callbacks) {
  RayOptions options{.max_error_px = settings.max_error,
                     .is_known = true,
                     .in_order = false,
                     .seed = settings.seed,
                     .threads = thread_count(settings.threads),
                     .stopped = [&callbacks] { return callbacks.stopped(); }};
  if (callbacks.progress) {
    options.progress = [&](int posed) {
      callbacks.progress("photo", posed, static_cast<int>(input.names.size()));
    };
  }
  RayReconstruction found = reconstruct_along_rays(input.tracks, *input.camera, options);
  pose_left_photos(settings, callbacks, options, &input, &found);
  if (found.posed == 0) {
    return no_reconstruction(
        fmt::format("{}: no three of the {} images start a reconstruction: too few points in "
                    "common, or too little parallax",
                    settings.input, input.names.size()));
  }
  const bool interrupted = input.interrupted || callbacks.stopped();
  return solve_result(input, found, settings, interrupted);
}

// Photos, or tracks in a file, of a camera that is given.
Result<SolveResult> solve_known(const SolveSettings& settings, const SolveCallbacks& callbacks) {
  Result<SolveInput> input = is_tracks_file(settings.input) ? tracks_of_camera(settings, callbacks)
                                                            : tracks_from_photos(settings, callbacks);
  if (!input) return input.error();
  return solve_with_camera(*std::move(input), settings, callbacks);
}

}  // namespace

Result<SolveResult> solve(const SolveSettings& settings, const SolveCallbacks& callbacks) {
  const Clock::time_point start = Clock::now();
  if (auto r = validate(settings); !r) return r.error();
  const SolveCallbacks once = callbacks.ready_once();
  if (!settings.camera.empty()) {
    Result<SolveResult> result = solve_known(settings, once);
    if (!result) return result;
    warn(callbacks.event, &*result);
    set_times(start, 0, &*result);
    return result;
  }
  Result<SolveInput> input = read_input(settings, once);
  if (!input) return input.error();
  if (const std::string still = no_motion(*input); !still.empty() && !input->interrupted) {
    return no_reconstruction(fmt::format("{}: {}", settings.input, still));
  }
  if (input->tracks.size() == 0 && !is_tracks_file(settings.input) && !input->interrupted) {
    return no_reconstruction(
        fmt::format("{}: no point is seen in two of its {} images", settings.input, input->names.size()));
  }
  const double read_s = milliseconds_since(start) / 1000.0;
  Result<UncalibratedReconstruction> found = reconstruct_further(&*input, settings, callbacks);
  if (found) pose_repeats(*input, &*found);
  if (auto r = try_as_photos(settings, once, &*input, &found); !r) return r.error();
  if (!found) return Error{found.error().kind, fmt::format("{}: {}", settings.input, found.error().message)};
  std::optional<SolveResult> tracked;
  if (is_video(settings, *input) && is_incomplete(*input, *found) && !callbacks.stopped()) {
    Result<std::optional<SolveResult>> r = tracked_with_lens(*input, *found, settings, callbacks);
    if (!r) return r.error();
    tracked = *std::move(r);
  }
  const bool interrupted = input->interrupted || callbacks.stopped();
  SolveResult result =
      tracked ? *std::move(tracked) : solve_result(*input, *std::move(found), settings, interrupted);
  warn(callbacks.event, &result);
  set_times(start, read_s, &result);
  return result;
}

}  // namespace raysfm
