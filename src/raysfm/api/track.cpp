#include "raysfm/api/track.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <new>
#include <optional>

#include "raysfm/api/checkpoint.h"
#include "raysfm/api/find_lens.h"
#include "raysfm/api/given_lens.h"
#include "raysfm/api/narrator.h"
#include "raysfm/api/run_map.h"
#include "raysfm/api/track_sources.h"
#include "raysfm/api/track_zoom.h"
#include "raysfm/camera/camera_class.h"
#include "raysfm/core/memory.h"
#include "raysfm/core/thread_pool.h"
#include "raysfm/frames/frame_source.h"
#include "raysfm/odometry/tracker.h"
#include "raysfm/scene/frame_lens.h"
#include "raysfm/scene/worlds.h"
#include "raysfm/streams/view_stream.h"

namespace raysfm {
namespace {

// Frames per second of footage that nobody told a rate of.
constexpr double kUsualRate = 30;
// The newest key frames, which are asked for the lens where the map does not tell it.
constexpr int kDoubtful = 16;

// A segment that lasted until a signal came did not end for want of input.
void explain_interruption(Reconstruction* reconstruction) {
  for (Segment& segment : reconstruction->segments) {
    if (segment.reason == "end of input") segment.reason = "interrupted";
  }
}

Report make_report(const TrackSettings& settings, const Tracker& tracker, const Sources& sources,
                   const StageTiming& decode) {
  Report report = tracker_report(settings, tracker);
  report.stages.insert(report.stages.begin(), {"decode", decode});
  if (sources.find_ms > 0) {
    StageTiming lens;
    lens.add(sources.find_ms);
    report.stages.insert(report.stages.begin(), {"lens", lens});
  }
  report.lens_origin = sources.origin;
  report.lens_origin->model = model_name(tracker.rig().rig().cameras[0].model);
  return report;
}

// Where the calibration came from, for messages.
std::string camera_source(const TrackSettings& settings, const Input& input) {
  if (!settings.camera.empty()) return settings.camera;
  return input.calibration_file ? input.calibration_file->string() : settings.inputs[0];
}

// Pushes every view there is, until told to stop. Whether it was. `calibration` is named where it is wrong.
Result<bool> push_all(ViewStream& stream, const TrackCallbacks& callbacks, int total,
                      const std::string& calibration, Tracker& tracker, Checkpoint& checkpoint,
                      TrackWatcher* watcher) {
  for (;;) try {
      if (callbacks.stopped()) return true;
      Result<ViewPtr> view = stream.next();
      if (!view) return view.error();
      if (!*view) return false;
      checkpoint.note(**view);
      const Result<FrameResult> frame = tracker.push(*std::move(view));
      if (!frame) return bad_input(fmt::format("{}: {}", calibration, frame.error().message));
      stream.detect_ahead(frame->state != TrackingState::kTracking);
      checkpoint.keep(tracker, callbacks.event);
      if (watcher) watcher->frame_done(tracker);
      if (callbacks.progress) callbacks.progress({tracker.frames(), total, tracker.posed()});
    } catch (const std::bad_alloc&) {
      return internal_error(fmt::format("not enough memory for frame {}", tracker.frames()));
    }
}

// Of a shutter that was found where time stamps only count frames; else empty.
std::string unit_warning(const Rig& rig, const Sources& sources) {
  const auto scans = [](const Camera& camera) { return camera.shutter.readout > 0; };
  if (!sources.input.times_are_indices || !(sources.prior.readout > 0) ||
      std::ranges::none_of(rig.cameras, scans)) {
    return "";
  }
  return "the images have no time stamps: the readout that was found is told as if they were a second apart; "
         "give --fps, or use its camera file with these images only";
}

// Tells a warning, and keeps it for the report; nothing where it is empty.
void warn(const EventSink& event, const std::string& warning, std::vector<std::string>* warnings) {
  if (warning.empty()) return;
  tell(event, Event::Level::kWarning, warning);
  warnings->push_back(warning);
}

// What there is to say of an input that was read to its end.
void tell_notes(const Input& input, const ViewStream& stream, const EventSink& event) {
  for (const auto& source : input.streams) tell(event, Event::Level::kWarning, source->note());
  tell(event, Event::Level::kWarning, stream.note());
}

// What became of an input.
struct InputRead {
  bool stopped = false;  // before its end
  StageTiming decode;
  int frames_in_input = -1;
};

// Pushes the input to its end, and closes it: decoders hold many images, and a result takes memory too.
Result<InputRead> read_through(const TrackSettings& settings, const TrackCallbacks& callbacks,
                               TrackWatcher* watcher, Checkpoint& checkpoint, Input* input,
                               Tracker& tracker) {
  InputRead read;
  {
    ViewStream stream(input->streams, tracker.maker(), thread_count(settings.threads), checkpoint.passed());
    FrameSource& source = *input->streams[0];
    Result<bool> stopped = checkpoint.go_on(stream, callbacks, tracker);
    if (stopped && !*stopped) {
      stopped = push_all(stream, callbacks, source.frame_count(), camera_source(settings, *input), tracker,
                         checkpoint, watcher);
    }
    if (!stopped) return stopped.error();
    if (tracker.frames() == 0 && !*stopped) {
      return bad_input(fmt::format("{}: no frames", source.description()));
    }
    if (!*stopped) tell_notes(*input, stream, callbacks.event);
    read = {*stopped, stream.finish(), source.frame_count()};
  }
  for (std::unique_ptr<FrameSource>& source : input->streams) source.reset();
  return read;
}

// Since the start of a run that has gone through so many frames.
void measure_cost(const Clock::time_point& start, int frames, Report* report) {
  report->wall_s = milliseconds_since(start) / 1000.0;
  report->frames_per_second = frames / report->wall_s;
  report->peak_rss_mib = peak_rss_mib();
}

// Of a run that was told to stop while it looked for the lens.
TrackResult interrupted_before_start(const TrackSettings& settings, const Clock::time_point& start) {
  TrackResult out;
  out.report.seed = settings.odometry.seed;
  out.report.input = settings.inputs;
  out.report.camera_class = to_string(CameraClass::kCentral);
  out.report.error = "pixel";
  out.report.interrupted = true;
  measure_cost(start, 0, &out.report);
  return out;
}

// What a run tells beside its result.
struct Aftermath {
  int shutter_found_at = -1, lens_found_at = -1;  // frame; -1: none was found
  bool dropped_shutter = false;
  std::optional<SeenZoom> zoom;
  std::vector<LensDoubt> doubts;
};

// Where time stamps only count frames: what is told in seconds, as of footage of the usual rate.
void count_in_frames(OdometryOptions* options) {
  options->calibration_prior.readout *= kUsualRate;
  options->velocity_reach *= kUsualRate;
}

// One run of the tracker, through to its result.
Result<TrackResult> track_cameras(TrackSettings settings, const TrackCallbacks& callbacks,
                                  TrackWatcher* watcher, RunMaps* maps, Sources* sources,
                                  Aftermath* aftermath) {
  settings.odometry.calibration_prior = sources->prior;
  if (sources->input.times_are_indices) count_in_frames(&settings.odometry);
  Narrator narrator(callbacks.event, sources->origin);
  ObserverPair observers(&narrator, watcher);
  Result<std::unique_ptr<Tracker>> made =
      Tracker::create(sources->rig,
                      {settings.odometry, std::move(sources->masks),
                       maps->known ? take_worlds(&*maps->known) : std::vector<Map>()},
                      &observers);
  if (!made) return made.error();
  if (auto r = callbacks.ready(); !r) return r.error();
  Tracker& tracker = **made;
  Checkpoint checkpoint(settings.checkpoint,
                        settings.checkpoint.empty() ? "" : run_identity(settings, sources->rig));
  if (auto r = checkpoint.read(callbacks.event); !r) return r.error();
  const Result<InputRead> read =
      read_through(settings, callbacks, watcher, checkpoint, &sources->input, tracker);
  if (!read) return read.error();

  TrackResult out;
  std::vector<std::string> warnings;
  warn(callbacks.event, motion_warning(tracker.other_motion()), &warnings);
  warn(callbacks.event, dropped_shutter_warning(tracker.dropped_shutter()), &warnings);
  aftermath->zoom = tracker.lens_change();
  aftermath->dropped_shutter = tracker.dropped_shutter();
  if (sources->may_be_fisheye) {
    warn(callbacks.event, wide_lens_warning(tracker.rig().rig().cameras[0]), &warnings);
  }
  std::vector<ViewPtr> keyframes;
  if (sources->lens_is_given() && !tells_focals(tracker.calibration()))
    keyframes = tracker.newest_keyframes(kDoubtful);
  std::vector<Map> worlds;
  out.reconstruction = tracker.finish(settings.final != "none", maps->writer ? &worlds : nullptr);
  aftermath->shutter_found_at = tracker.shutter_found_at();
  aftermath->lens_found_at = tracker.lens_found_at();
  if (auto r = save_maps(*maps, out.reconstruction, std::move(worlds)); !r) return r.error();
  out.reconstruction.range = settings.range;
  if (sources->lens_is_given() && !read->stopped) {
    aftermath->doubts = doubts_of_lenses(out.reconstruction, keyframes, tracker.rig(), tracker.maker(),
                                         settings.odometry.seed);
  }
  if (read->stopped) explain_interruption(&out.reconstruction);
  warn(callbacks.event, start_warning(out.reconstruction), &warnings);
  warn(callbacks.event, link_warning(out.reconstruction), &warnings);
  if (!tells_focals(out.reconstruction.calibration))
    warn(callbacks.event, vague_lens_warning(sources->origin), &warnings);
  warn(callbacks.event, unit_warning(out.reconstruction.rig, *sources), &warnings);
  out.report = make_report(settings, tracker, *sources, read->decode);
  out.report.warnings = std::move(warnings);
  out.report.interrupted = read->stopped;
  out.report.frames_in_input = read->frames_in_input;
  return out;
}

// Whether a rolling shutter was found only after most of the frames: these were posed without it, and what is
// between key frames never hears of it. Or one that was found is none.
bool has_other_shutter(const Aftermath& aftermath, const Reconstruction& tracked) {
  const auto scans = [](const Camera& camera) { return camera.shutter.readout > 0; };
  const bool is_late = aftermath.shutter_found_at >= 0 &&
                       2 * aftermath.shutter_found_at >= std::ssize(tracked.frames) &&
                       std::ranges::any_of(tracked.rig.cameras, scans);
  return is_late || aftermath.dropped_shutter;
}

// Whether much of the map had come about, and was bent, before a much better lens was found. Once is enough.
bool has_other_lens(const Aftermath& aftermath, const Sources& sources, const Reconstruction& tracked) {
  return aftermath.lens_found_at >= 0 && 4 * aftermath.lens_found_at >= std::ssize(tracked.frames) &&
         !sources.prior.is_found;
}

// `what` becomes of the footage then.
std::string found_late(const Aftermath& aftermath, bool is_for_shutter, std::string_view what) {
  return fmt::format("a {} was found at frame {}: {}",
                     is_for_shutter ? "rolling shutter" : "better calibration",
                     is_for_shutter ? aftermath.shutter_found_at : aftermath.lens_found_at, what);
}

std::string why_again(const Aftermath& aftermath, bool is_for_shutter) {
  if (aftermath.dropped_shutter) return "all is tracked again without a rolling shutter";
  return found_late(aftermath, is_for_shutter, "all is tracked again with it");
}

std::string why_not_again(const Aftermath& aftermath, bool is_for_shutter) {
  if (aftermath.dropped_shutter) return "";
  return found_late(aftermath, is_for_shutter,
                    "of a device, with --map or with --save-map nothing is tracked again; give the "
                    "camera.yaml of this run with --camera");
}

// What a second run began with was found by the first, of what it was given.
void tell_as_given(const std::vector<CalibrationNumber>& first, std::vector<CalibrationNumber>* second) {
  for (CalibrationNumber& now : *second) {
    const auto before = std::ranges::find_if(
        first, [&](const CalibrationNumber& n) { return n.camera == now.camera && n.name == now.name; });
    if (before == first.end()) continue;
    now.given = before->given;
    now.significance = std::max(now.significance, before->significance);
  }
}

// The footage tracked again with the cameras that are known now, where much of it was tracked with others.
std::optional<TrackResult> with_known_cameras(const TrackSettings& given, const TrackCallbacks& callbacks,
                                              const Sources& sources, const Aftermath& aftermath,
                                              TrackResult* tracked) {
  const Reconstruction& first = tracked->reconstruction;
  const bool is_for_shutter = has_other_shutter(aftermath, first);
  if (!(is_for_shutter || has_other_lens(aftermath, sources, first)) || callbacks.stopped())
    return std::nullopt;
  if (sources.input.layout == "device" || !given.map.empty() || !given.save_map.empty()) {
    warn(callbacks.event, why_not_again(aftermath, is_for_shutter), &tracked->report.warnings);
    return std::nullopt;
  }
  tell(callbacks.event, Event::Level::kInfo, why_again(aftermath, is_for_shutter));
  FoundLens lens{sources.rig, sources.prior, sources.origin, !sources.may_be_fisheye, true};
  lens.zoom = sources.undone_zoom;
  // What a file says of a lens stands beside a shutter; what was found as if none rolled does not.
  if (!is_for_shutter || !sources.lens_is_given()) lens.rig = first.rig;
  lens.prior.is_found = !is_for_shutter;
  if (aftermath.dropped_shutter) lens.prior.readout = 0;
  for (size_t c = 0; c < lens.rig.cameras.size(); ++c)
    lens.rig.cameras[c].shutter = first.rig.cameras[c].shutter;
  TrackSettings settings = given;
  settings.checkpoint.clear();
  if (aftermath.dropped_shutter) settings.rolling_shutter = "none";
  TrackCallbacks quiet;
  quiet.stop = callbacks.stop;
  Result<TrackResult> again = track(settings, quiet, nullptr, &lens);
  if (!again || callbacks.stopped()) return std::nullopt;
  const Reconstruction& second = again->reconstruction;
  const bool loses_some =
      posed_count(second) < posed_count(first) || placed_count(second) < placed_count(first);
  if (loses_some || second.segments.size() > first.segments.size()) return std::nullopt;
  if (!is_for_shutter) tell_as_given(first.calibration, &again->reconstruction.calibration);
  if (aftermath.dropped_shutter) {
    std::ranges::copy_if(first.calibration, std::back_inserter(again->reconstruction.calibration),
                         [](const CalibrationNumber& n) { return n.name.starts_with("readout"); });
  }
  warn({}, dropped_shutter_warning(aftermath.dropped_shutter), &again->report.warnings);
  auto& stages = again->report.stages;
  if (sources.find_ms > 0) stages.insert(stages.begin(), tracked->report.stages.front());
  return *std::move(again);
}

// What makes all of a result doubtful comes first.
void warn_first(const TrackCallbacks& callbacks, const std::string& warning, TrackResult* result) {
  tell(callbacks.event, Event::Level::kWarning, warning);
  result->report.warnings.insert(result->report.warnings.begin(), warning);
}

// The footage tracked with its own lens instead, where that is another one than the given. Else what there is
// to say is said in `tracked`, whose scale is then as doubtful as its cameras.
std::optional<TrackResult> with_own_lens(const TrackSettings& given, const TrackCallbacks& callbacks,
                                         const Sources& sources, const std::vector<LensDoubt>& doubts,
                                         TrackResult* tracked) {
  const GivenCameras cameras{sources.rig, sources.input.layout != "device"};
  std::string warning;
  std::optional<TrackResult> own = track_with_own_lens(given, callbacks, cameras, doubts, *tracked, &warning);
  if (own) {
    for (const std::string& w : own->report.warnings) tell(callbacks.event, Event::Level::kWarning, w);
  }
  if (!warning.empty()) warn_first(callbacks, warning, own ? &*own : tracked);
  if (own || warning.empty()) return own;
  Reconstruction& r = tracked->reconstruction;
  r.metric_scale = false;
  for (Segment& segment : r.segments) segment.metric_scale = false;
  return std::nullopt;
}

ZoomRoute zoom_route(const Sources& sources) {
  constexpr double kSquare = 0.02;
  if (sources.zoom.may_be_solved) return ZoomRoute::kSolveThenMap;
  const std::optional<Lens> lens = lens_of(sources.rig.cameras[0]);
  const bool is_square = lens && std::abs(lens->fx / lens->fy - 1) < kSquare;
  return sources.lens_is_given() && is_square ? ZoomRoute::kMapThenSolve : ZoomRoute::kMap;
}

// The footage with a lens for each image, where the camera seems to zoom and that is better. Else what there
// is to say of it is said in `tracked`.
std::optional<TrackResult> with_zoom(const TrackSettings& given, const TrackCallbacks& callbacks,
                                     const Sources& sources, const std::optional<SeenZoom>& change,
                                     TrackResult* tracked) {
  const Reconstruction& r = tracked->reconstruction;
  if (r.rig.cameras.size() != 1) return std::nullopt;
  // A rolling shutter bends the images of a moving camera as a zoom does.
  const bool scans = r.rig.cameras[0].shutter.readout > 0;
  std::string zoom = scans ? "" : sources.zoom.warning;
  if (change) zoom = zoom_warning(*change);
  const bool may_be_another = sources.input.layout != "device" && can_have_lenses(given);
  const bool is_short = can_be_solved(given, static_cast<double>(r.keyframes.size()));
  const bool is_asked = may_be_another && is_short && (sources.zoom.may_be || sources.lens_is_given());
  if (zoom.empty() && is_asked && !callbacks.stopped()) zoom = zoom_warning(zoom_in_map(r));
  std::optional<TrackResult> better;
  if (!zoom.empty() && may_be_another && !callbacks.stopped())
    better = better_by_zoom(given, callbacks, *tracked, is_short ? zoom_route(sources) : ZoomRoute::kMap);
  if (better) return better;
  tell(callbacks.event, Event::Level::kWarning, zoom);
  if (!zoom.empty()) tracked->report.warnings.push_back(zoom);
  return std::nullopt;
}

}  // namespace

Report tracker_report(const TrackSettings& settings, const Tracker& tracker) {
  const OdometryTimings t = tracker.timings();
  Report report;
  report.seed = settings.odometry.seed;
  report.input = settings.inputs;
  report.camera_class = to_string(camera_class(tracker.rig().rig()));
  report.error = tracker.rig().angular() ? "angular" : "pixel";
  report.stages = {{"detect", t.detect}, {"start", t.start},         {"match", t.match},
                   {"pose", t.pose},     {"align", t.align},         {"keyframe", t.keyframe},
                   {"adjust", t.adjust}, {"calibrate", t.calibrate}, {"frame", t.frame}};
  return report;
}

Result<TrackResult> track(const TrackSettings& given, const TrackCallbacks& caller, TrackWatcher* watcher,
                          const FoundLens* found) {
  const Clock::time_point start = Clock::now();
  const TrackCallbacks callbacks = caller.ready_once();
  TrackSettings settings = given;
  const Result<OdometryOptions> odometry = odometry_options(given);
  if (!odometry) return odometry.error();
  settings.odometry = *odometry;
  Result<RunMaps> maps = open_maps(settings, callbacks.event);
  if (!maps) return maps.error();
  Result<Sources> sources = open_sources(settings, maps->known, found, callbacks);
  if (!sources) {
    const bool no_lens_yet = sources.error().kind == ErrorKind::kNoReconstruction && callbacks.stopped();
    return no_lens_yet ? Result(interrupted_before_start(settings, start)) : sources.error();
  }
  std::optional<TrackResult>& solved = sources->zoom.solved;
  const auto with_costs = [&](TrackResult result) {
    measure_cost(start, static_cast<int>(result.reconstruction.frames.size()), &result.report);
    return result;
  };
  const auto solved_instead = [&] {
    warn_first(callbacks, zoom_range(*solved), &*solved);
    return with_costs(*std::move(solved));
  };
  if (solved) return solved_instead();
  Aftermath aftermath;
  Result<TrackResult> tracked = track_cameras(settings, callbacks, watcher, &*maps, &*sources, &aftermath);
  if (!tracked || (found && found->is_guess)) return tracked;
  std::optional<TrackResult> own;
  if (!aftermath.doubts.empty() && !callbacks.stopped())
    own = with_own_lens(given, callbacks, *sources, aftermath.doubts, &*tracked);
  if (own) {
    tracked = *std::move(own);
    aftermath.zoom.reset();  // of the other lens
  } else if (auto again = with_known_cameras(given, callbacks, *sources, aftermath, &*tracked)) {
    tracked = *std::move(again);
  }
  if (!found) solved = with_zoom(given, callbacks, *sources, aftermath.zoom, &*tracked);
  if (solved) return solved_instead();
  return with_costs(*std::move(tracked));
}

}  // namespace raysfm
