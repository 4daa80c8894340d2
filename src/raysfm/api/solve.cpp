#include "raysfm/api/solve.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "raysfm/api/find_lens.h"
#include "raysfm/api/solve_by_tracking.h"
#include "raysfm/api/solve_result.h"
#include "raysfm/api/zoom_by_tracking.h"
#include "raysfm/core/memory.h"
#include "raysfm/core/timer.h"
#include "raysfm/ray_lenses/ray_reconstruction.h"
#include "raysfm/results/tracks_file.h"
#include "raysfm/scene/worlds.h"
#include "raysfm/solving/joined_stretches.h"
#include "raysfm/solving/reconstruct_input.h"
#include "raysfm/solving/reconstruct_photos.h"
#include "raysfm/solving/solve_input.h"
#include "raysfm/solving/solve_photos.h"
#include "raysfm/solving/worlds_left_out.h"

namespace raysfm {
namespace {

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

// What of a video leaves key frames out goes on with what joins its stretches, where that poses more. `input`
// becomes what the reconstruction is of.
Result<UncalibratedReconstruction> reconstruct(SolveInput* input, const SolveSettings& settings,
                                               const SolveCallbacks& callbacks) {
  if (input->photo_points.features) return reconstruct_photos(input, settings, callbacks);
  Result<UncalibratedReconstruction> found = reconstruct_input(input, settings, callbacks);
  auto joined = joined_stretches(*input, found ? &*found : nullptr, settings, callbacks);
  if (!joined) return found;
  Result<UncalibratedReconstruction> other =
      reconstruct_input(&joined->input, settings, callbacks, joined->start ? &*joined->start : nullptr);
  if (!(reached_share(other) > reached_share(found))) return found;
  *input = std::move(joined->input);
  return other;
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
  Result<UncalibratedReconstruction> other = reconstruct(&*photos, settings, callbacks);
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

// Photos, or tracks in a file, of a camera that is given: poses and map, adjusted together.
Result<SolveResult> solve_known(const SolveSettings& settings, const SolveCallbacks& callbacks) {
  Result<SolveInput> input = is_tracks_file(settings.input) ? tracks_of_camera(settings, callbacks)
                                                            : tracks_from_photos(settings, callbacks);
  if (!input) return input.error();
  const std::vector<RayReconstruction> worlds = reconstruct_worlds_of_camera(&*input, settings, callbacks);
  if (worlds.empty()) {
    return no_reconstruction(
        fmt::format("{}: no three of the {} images start a reconstruction: too few points in "
                    "common, or too little parallax",
                    settings.input, input->names.size()));
  }
  return solve_result(*input, worlds, settings, input->interrupted || callbacks.stopped());
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
  Result<UncalibratedReconstruction> found = reconstruct(&*input, settings, callbacks);
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
  const auto others = worlds_left_out(*input, *found, settings, callbacks);
  SolveResult result =
      tracked ? *std::move(tracked) : solve_result(*input, *std::move(found), others, settings, interrupted);
  if (is_video(settings, *input) && result.report.lens->zooming && !callbacks.stopped()) {
    if (auto better = tracked_through_zoom(result, settings, callbacks)) result = *std::move(better);
  }
  warn(callbacks.event, &result);
  set_times(start, read_s, &result);
  return result;
}

}  // namespace raysfm
