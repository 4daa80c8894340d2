#include "raysfm/api/track_sources.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "raysfm/api/find_lens.h"
#include "raysfm/api/run_map.h"
#include "raysfm/api/track_zoom.h"
#include "raysfm/camera/camera_check.h"
#include "raysfm/camera_files/camera_file.h"
#include "raysfm/core/timer.h"
#include "raysfm/frames/image_file.h"
#include "raysfm/settings/config.h"

namespace raysfm {
namespace {

Result<Rig> read_rig(const TrackSettings& settings, Input& input, const EventSink& event) {
  if (settings.camera.empty()) {
    if (settings.fov > 0) {
      tell(event, Event::Level::kWarning,
           fmt::format("the field of view is not used, {} tells it", input.calibration_file->string()));
    }
    return *std::move(input.calibration);
  }
  std::string note;
  Result<Rig> rig = read_camera_file(settings.camera, &note);
  if (!rig) return rig;
  tell(event, Event::Level::kWarning, note);
  rig = rig_for_streams(*std::move(rig), input.streams, &note, settings.mono);
  if (!rig) return bad_input(fmt::format("{}: {}", settings.camera, rig.error().message));
  tell(event, Event::Level::kWarning, note);
  if (input.calibration_file) {
    tell(event, Event::Level::kInfo,
         fmt::format("{} is not used, {} is given", input.calibration_file->string(), settings.camera));
  }
  return rig;
}

Rig cameras_in_use(Rig rig, const TrackSettings& settings) {
  if (settings.mono) rig.cameras.resize(1);
  // One camera does not tell where the rig's frame is: a lever arm in metres would mean nothing in a world of
  // arbitrary scale. The camera is the rig.
  if (rig.cameras.size() == 1) rig.cameras[0].rig_from_cam = Rigid3{};
  return rig;
}

// Where the camera sees the scene, as the user says.
Result<GrayImage> mask_of(const Camera& camera, const Input& input) {
  std::filesystem::path path = camera.mask_path;
  if (path.empty() && input.mask && input.streams.size() == 1) path = *input.mask;
  GrayImage mask;
  if (!path.empty()) {
    Result<GrayImage> read = read_mask(path, camera.width, camera.height);
    if (!read) return read.error();
    mask = *std::move(read);
  }
  return mask;
}

Result<Sources> sources_with_lens(const TrackSettings& settings, const FoundLens& lens) {
  Result<Input> input = open_inputs(settings, true);
  if (!input) return input.error();
  if (lens.rig.cameras.size() == 1) input->streams.resize(1);
  if (lens.zoom.any()) input->streams[0] = unzoomed(std::move(input->streams[0]), lens.zoom);
  return Sources{*std::move(input),
                 lens.rig,
                 {},
                 lens.origin,
                 lens.prior,
                 0,
                 lens.origin.source == "footage" && !lens.told_apart,
                 lens.zoom};
}

// Cameras that no file tells: the input is read for them, and opened again.
Result<Sources> sources_of_found_lens(const TrackSettings& settings, Input input,
                                      const TrackCallbacks& callbacks) {
  const Clock::time_point start = Clock::now();
  // solve() reads the input once more, and takes pixels to be square.
  const bool may_be_solved = input.layout != "device" && input.streams[0]->pixel_aspect() == 1;
  ZoomedStretch stretch;
  Result<FoundLens> lens = find_lens(settings, std::move(input), callbacks, &stretch);
  // Where there is a lens, the map of it tells more, in a fraction of the time: of a shutter, too.
  // A video that zooms has no lens, whether a stretch looks like a zoom or not.
  const bool is_asked = !lens && stretch.keyframes > 0 && may_be_solved &&
                        can_be_solved(settings, stretch.keyframes) && !callbacks.stopped();
  std::optional<TrackResult> solved;
  if (is_asked) {
    tell(
        callbacks.event, Event::Level::kInfo,
        stretch.is_seen()
            ? fmt::format("frames {} to {} look as if the camera zoomed: a lens is looked for for each image",
                          stretch.first_frame, stretch.last_frame)
            : "there may be no one lens: one is looked for for each image");
    solved = solved_zoom(settings, callbacks);
    const bool is_believed =
        solved && is_clear_zoom(*solved) && (stretch.is_seen() || solved->report.lens->zoom_undone);
    if (!is_believed) solved.reset();
  }
  if (!lens && !solved) return lens.error();
  Result<Sources> sources = lens ? sources_with_lens(settings, *lens) : Sources();
  if (!sources) return sources;
  if (stretch.is_seen() && !solved) sources->zoom.warning = zoom_warning(stretch);
  sources->zoom.may_be = lens && wide_lens_warning(lens->camera()).empty();
  sources->zoom.may_be_solved = may_be_solved;
  sources->zoom.solved = std::move(solved);
  sources->find_ms = milliseconds_since(start);
  return sources;
}

Result<Sources> sources_of_cameras(const TrackSettings& settings, const std::optional<SavedMap>& known,
                                   const TrackCallbacks& callbacks) {
  Result<Input> input = open_inputs(settings);
  if (!input) return input.error();
  if (settings.camera.empty() && !input->calibration) {
    if (known) return Sources{*std::move(input), known->rig, {}, {}, {}};
    return sources_of_found_lens(settings, *std::move(input), callbacks);
  }
  Result<Rig> rig = read_rig(settings, *input, callbacks.event);
  if (!rig) return rig.error();
  Rig in_use = cameras_in_use(*std::move(rig), settings);
  if (known) {
    Result<Rig> of_map = cameras_of_map(settings, *known, std::move(in_use));
    if (!of_map) return of_map.error();
    in_use = *std::move(of_map);
  }
  return Sources{*std::move(input), std::move(in_use), {}, {}, {}};
}

}  // namespace

Result<Input> open_inputs(const TrackSettings& settings, bool lens_is_found) {
  return open_input(settings.inputs, {.fps = settings.fps,
                                      .mono = settings.mono,
                                      .ignore_calibration = lens_is_found || !settings.camera.empty(),
                                      .threads = settings.threads,
                                      .range = settings.range});
}

Result<Sources> open_sources(const TrackSettings& settings, const std::optional<SavedMap>& known,
                             const FoundLens* found, const TrackCallbacks& callbacks) {
  const EventSink& event = callbacks.event;
  if (auto r = check_threads(settings.threads); !r) return r.error();
  if (auto r = validate(settings.odometry); !r) return r.error();
  if (auto r = check_fov(settings); !r) return r.error();
  Result<Sources> opened =
      found ? sources_with_lens(settings, *found) : sources_of_cameras(settings, known, callbacks);
  if (!opened) return opened;
  Sources& sources = *opened;
  if (auto r = set_rolling_shutter(settings.rolling_shutter, &sources.rig, &sources.prior); !r)
    return r.error();
  for (const std::string& warning : place_warnings(sources.rig)) tell(event, Event::Level::kWarning, warning);
  for (const Camera& camera : sources.rig.cameras) {
    Result<GrayImage> mask = mask_of(camera, sources.input);
    if (!mask) return mask.error();
    sources.masks.push_back(*std::move(mask));
  }
  return opened;
}

}  // namespace raysfm
