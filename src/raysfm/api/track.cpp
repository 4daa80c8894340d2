#include "raysfm/api/track.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <new>
#include <optional>

#include "raysfm/api/checkpoint.h"
#include "raysfm/api/config.h"
#include "raysfm/api/find_lens.h"
#include "raysfm/api/run_map.h"
#include "raysfm/api/track_zoom.h"
#include "raysfm/camera/camera_check.h"
#include "raysfm/camera/camera_class.h"
#include "raysfm/camera_files/camera_file.h"
#include "raysfm/core/memory.h"
#include "raysfm/core/thread_pool.h"
#include "raysfm/files/text_file.h"
#include "raysfm/frames/frame_source.h"
#include "raysfm/frames/image_file.h"
#include "raysfm/odometry/tracker.h"
#include "raysfm/scene/weak_links.h"
#include "raysfm/scene/worlds.h"
#include "raysfm/streams/view_stream.h"

namespace raysfm {
namespace {

// What a run works on, opened and found to fit together.
struct Sources {
  Input input;
  Rig rig;
  std::vector<GrayImage> masks;  // by camera; empty: none is given
  LensOrigin origin;
  CalibrationPrior prior;
  double find_ms = 0;           // that finding the lens took
  bool may_be_fisheye = false;  // nothing tells whether the lens that was found is none
  // Of a lens that no file told.
  struct {
    bool may_be = false, may_be_solved = false;  // asked of the map; and solve() then
    std::optional<TrackResult> solved;           // with a lens for each image
    std::string warning;                         // of signs that came to nothing
  } zoom = {};

  bool lens_is_given() const { return origin.source == "camera file"; }
};

// Standard deviation of a readout that nobody told, seconds: phones take 10 to 33 milliseconds.
constexpr double kUsualReadout = 0.02;
// Frames per second of footage that nobody told a rate of.
constexpr double kUsualRate = 30;
// Key frames of footage that is too short for the tracker to measure a zoom by the way.
constexpr int kShort = 40;
// The newest key frames, which are asked for the lens where the map does not tell it.
constexpr int kDoubtful = 16;

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
  return Sources{*std::move(input),
                 lens.rig,
                 {},
                 lens.origin,
                 lens.prior,
                 0,
                 lens.origin.source == "footage" && !lens.told_apart};
}

// Cameras that no file tells: the input is read for them, and opened again.
Result<Sources> sources_of_found_lens(const TrackSettings& settings, Input input,
                                      const TrackCallbacks& callbacks) {
  const Clock::time_point start = Clock::now();
  // solve() reads the input once more, and takes pixels to be square.
  const bool may_be_solved = input.layout != "device" && input.streams[0]->pixel_aspect() == 1;
  ZoomedStretch stretch;
  Result<FoundLens> lens = find_lens(settings, std::move(input), callbacks, &stretch);
  const bool seen = stretch.last_frame >= 0;
  // Where there is a lens, the map of it tells more, in a fraction of the time: of a shutter, too.
  const bool zooms =
      seen && !lens && may_be_solved && can_be_solved(settings, stretch.keyframes) && !callbacks.stopped();
  std::optional<TrackResult> solved;
  if (zooms) {
    tell(callbacks.event, Event::Level::kInfo,
         fmt::format("frames {} to {} look as if the camera zoomed: a lens is looked for for each image",
                     stretch.first_frame, stretch.last_frame));
    solved = solved_zoom(settings, callbacks);
  }
  if (!lens && !solved) return lens.error();
  Result<Sources> sources = lens ? sources_with_lens(settings, *lens) : Sources();
  if (!sources) return sources;
  if (seen && !solved) sources->zoom.warning = zoom_warning(stretch);
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

// `found`: the lens, where somebody else has found it; else null.
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

// Everything as in LBA09, as far as it can be chosen: what the paper does not have is left out.
void follow_paper(TrackSettings* settings) {
  settings->refine_lens = settings->loops = "off";
  settings->rolling_shutter = "none";
  settings->odometry.paper_window = true;
  settings->odometry.departures = kNoDepartures;
}

// The methods that the settings name, for the pipeline.
Result<void> choose_methods(TrackSettings* settings) {
  static constexpr std::pair<std::string_view, ErrorMeasure> kErrors[] = {
      {"auto", ErrorMeasure::kAuto},
      {"pixel", ErrorMeasure::kPixel},
      {"angular", ErrorMeasure::kAngular},
      {"angular-plain", ErrorMeasure::kAngularPlain}};
  static constexpr std::pair<std::string_view, GenericStartMethod> kStarts[] = {
      {"auto", GenericStartMethod::kAuto},
      {"five-point", GenericStartMethod::kCentral},
      {"pless", GenericStartMethod::kSeventeenPoint}};
  static constexpr std::pair<std::string_view, LensRefinement> kRefinements[] = {
      {"auto", LensRefinement::kAuto}, {"on", LensRefinement::kOn}, {"off", LensRefinement::kOff}};
  static constexpr std::pair<std::string_view, bool> kLoops[] = {{"on", true}, {"off", false}};
  static constexpr std::pair<std::string_view, FinalAdjustment> kFinals[] = {
      {"none", FinalAdjustment::kGlobal},
      {"global", FinalAdjustment::kGlobal},
      {"hierarchical", FinalAdjustment::kHierarchical}};
  const auto choose = [](const auto& table, const char* flag, const std::string& name,
                         auto* value) -> Result<void> {
    for (const auto& [known, method] : table) {
      if (known == name) return *value = method, Result<void>();
    }
    return bad_input(fmt::format("{} = {}: unknown; see --help", flag, name));
  };
  const bool as_paper = settings->preset == "lba09";
  if (as_paper) follow_paper(settings);
  if (auto r = leave_out(settings->without, &settings->odometry.departures); !r) return r;
  if (auto r = choose(kErrors, "--error", settings->error, &settings->odometry.error); !r) return r;
  if (as_paper && settings->error == "auto") settings->odometry.error = ErrorMeasure::kPaper;
  if (auto r = choose(kStarts, "--start", settings->start, &settings->odometry.start); !r) return r;
  if (auto r = choose(kLoops, "--loops", settings->loops, &settings->odometry.loops); !r) return r;
  if (auto r = choose(kFinals, "--final", settings->final, &settings->odometry.final); !r) return r;
  return choose(kRefinements, "--refine-lens", settings->refine_lens, &settings->odometry.refine_lens);
}

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

std::string changes_in(const std::vector<CalibrationNumber>& numbers) {
  std::string text;
  for (const CalibrationNumber& n : numbers) {
    if (n.refined == n.given) continue;
    const std::string camera = n.camera > 0 ? fmt::format("camera {} ", n.camera) : "";
    text += fmt::format("{}{}{} {:.6g} instead of {:.6g} (sigma {:.2g})", text.empty() ? "" : ", ", camera,
                        n.name, n.refined, n.given, n.sigma);
  }
  return text.empty() ? "the given one" : text;
}

// Puts into words what the user is told as it happens. While nothing starts, why not is told now and then.
class Narrator : public TrackerObserver {
 public:
  Narrator(const EventSink& event, const LensOrigin& origin) : event_(event), origin_(origin) {}

  void world_started(const WorldStarted& e) override {
    const std::vector<int>& frames = e.start.frames;
    next_refusal_ = 0;
    tell(event_, Event::Level::kInfo,
         fmt::format("started from frames {}, {}, {} with {} points", frames[0], frames[1], frames[2],
                     e.start.inliers));
  }
  void start_refused(const StartRefused& e) override {
    constexpr int kToldEvery = 30;  // frames
    if (e.frame < next_refusal_) return;
    next_refusal_ = e.frame + kToldEvery;
    tell(event_, Event::Level::kWarning, fmt::format("no start yet: {}", e.reason));
  }
  void calibration_refined(const CalibrationRefined& e) override {
    const std::string text = changes_in(e.numbers);
    if (e.contradicts) {
      tell(event_, Event::Level::kWarning,
           fmt::format("the lens is another one than that of the {}; at frame {} goes on with {}",
                       origin_.source, e.frame, text));
    } else {
      tell(event_, Event::Level::kInfo, fmt::format("calibration refined at frame {}: {}", e.frame, text));
    }
  }
  void track_lost(const TrackLost& e) override {
    next_refusal_ = 0;
    tell(event_, Event::Level::kWarning, fmt::format("track lost at frame {}: {}", e.frame, e.reason));
  }
  void track_found(const TrackFound& e) override {
    tell(event_, Event::Level::kInfo,
         fmt::format("track found again at frame {} in key frame {}", e.frame, e.keyframe));
  }
  void place_seen_again(const PlaceSeenAgain& e) override {
    const Closure& c = e.closure;
    const std::string earlier =
        c.with_frame < 0 ? "an earlier run" : fmt::format("frame {}", c.with_frame);  // that the map is of
    tell(event_, Event::Level::kInfo,
         fmt::format("frame {} sees what {} saw ({} points): {}", c.frame, earlier, c.inliers,
                     c.joined_worlds ? "worlds joined" : "loop closed"));
  }
  void marks_found(const MarksFound& e) override {
    tell(event_, Event::Level::kInfo,
         fmt::format(
             "{:.0f} % of the image stays in its place while the rest moves (a text, a logo, a bonnet): "
             "it is left out from frame {} on",
             100 * e.part, e.frame));
  }

 private:
  const EventSink& event_;
  const LensOrigin& origin_;
  int next_refusal_ = 0;  // frame from which one is told
};

// Tells two observers; the second may be null.
class ObserverPair : public TrackerObserver {
 public:
  ObserverPair(TrackerObserver* first, TrackerObserver* second) : first_(first), second_(second) {}

  void frame_posed(const FramePosed& e) override { tell(&TrackerObserver::frame_posed, e); }
  void world_started(const WorldStarted& e) override { tell(&TrackerObserver::world_started, e); }
  void start_refused(const StartRefused& e) override { tell(&TrackerObserver::start_refused, e); }
  void keyframe_added(const KeyFrameAdded& e) override { tell(&TrackerObserver::keyframe_added, e); }
  void map_adjusted(const MapAdjusted& e) override { tell(&TrackerObserver::map_adjusted, e); }
  void calibration_refined(const CalibrationRefined& e) override {
    tell(&TrackerObserver::calibration_refined, e);
  }
  void track_lost(const TrackLost& e) override { tell(&TrackerObserver::track_lost, e); }
  void track_found(const TrackFound& e) override { tell(&TrackerObserver::track_found, e); }
  void place_seen_again(const PlaceSeenAgain& e) override { tell(&TrackerObserver::place_seen_again, e); }
  void marks_found(const MarksFound& e) override { tell(&TrackerObserver::marks_found, e); }

 private:
  template <typename What>
  void tell(void (TrackerObserver::*hear)(const What&), const What& e) {
    (first_->*hear)(e);
    if (second_) (second_->*hear)(e);
  }

  TrackerObserver* first_;
  TrackerObserver* second_;
};

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

std::string zoom_warning(const SeenZoom& change) {
  return fmt::format(
      "the camera zooms: its focal length is {:.0f} px before frame {} and {:.0f} px from there on; "
      "poses are of one lens, raysfm solve finds a lens for each image",
      change.before, change.frame, change.after);
}

// Of the stretch where it is most; empty where there is none.
std::string motion_warning(const std::vector<OtherMotion>& seen) {
  if (seen.empty()) return "";
  const OtherMotion& most = *std::ranges::max_element(seen, {}, &OtherMotion::part);
  const std::string more = seen.size() > 1 ? fmt::format(", and in {} more stretches", seen.size() - 1) : "";
  return fmt::format(
      "{:.0f} % of what frames {} to {} show does not stand still in the world that was tracked{}: the path "
      "may be that of something that moves",
      100 * most.part, most.first, most.last, more);
}

std::string dropped_shutter_warning(bool is_dropped) {
  return is_dropped ? "rows of the images are exposed in one order in a part of the footage and in the other "
                      "in another, as where a part plays backwards: no rolling shutter is taken into account"
                    : "";
}

// Of a main world that is the three views of its start, else empty: a map that is wrong seldom grows, and of
// one that did not nothing says that it is right.
std::string start_warning(const Reconstruction& r) {
  constexpr int kMayGrow = 10;  // frames with a pose, from which on another key frame is to be expected
  const std::vector<int> worlds = worlds_in_order(r);
  if (worlds.empty()) return "";
  const auto in_main = [&](const PosedFrame& frame) { return frame.segment == worlds[0]; };
  const auto frames = std::ranges::count_if(r.frames, in_main);
  const auto keyframes =
      std::ranges::count_if(r.keyframes, [&](const KeyFrame& k) { return in_main(r.frames[k.frame]); });
  if (frames < kMayGrow || keyframes != 3) return "";
  return fmt::format(
      "the map is that of the three views which started it, and none of {} frames has added to it: nothing "
      "later says that it is right",
      frames);
}

// Of the weakest place; empty where there is none.
std::string link_warning(const Reconstruction& r) {
  const std::vector<WeakLink> links = weak_links(r);
  if (links.empty()) return "";
  const WeakLink& weakest = *std::ranges::min_element(links, {}, &WeakLink::points);
  const std::string more =
      links.size() > 1 ? fmt::format(", and {} more places by few", links.size() - 1) : "";
  return fmt::format(
      "frames {} to {} are held together by {} points ({:.0f} in the median){}: the path may have another "
      "scale after them than before",
      weakest.first, weakest.last, weakest.points, weakest.usual, more);
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
  int shutter_found_at = -1;  // frame; -1: none was found
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
  aftermath->shutter_found_at = tracker.shutter_found_at();
  aftermath->dropped_shutter = tracker.dropped_shutter();
  if (sources->may_be_fisheye) {
    warn(callbacks.event, wide_lens_warning(tracker.rig().rig().cameras[0]), &warnings);
  }
  std::vector<ViewPtr> keyframes;
  if (sources->lens_is_given() && !tells_focals(tracker.calibration()))
    keyframes = tracker.newest_keyframes(kDoubtful);
  std::vector<Map> worlds;
  out.reconstruction = tracker.finish(settings.final != "none", maps->writer ? &worlds : nullptr);
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

// Where a rolling shutter was found only after most of the frames: these were posed without it, and what is
// between key frames never hears of it. Or where one that was found is none. The footage tracked again, with
// the readout that is known now.
std::optional<TrackResult> with_known_shutter(const TrackSettings& given, const TrackCallbacks& callbacks,
                                              const Sources& sources, const Aftermath& aftermath,
                                              const TrackResult& tracked) {
  const Reconstruction& first = tracked.reconstruction;
  const int found_at = aftermath.shutter_found_at;
  const auto scans = [](const Camera& camera) { return camera.shutter.readout > 0; };
  const bool is_late = found_at >= 0 && 2 * found_at >= std::ssize(first.frames) &&
                       std::ranges::any_of(first.rig.cameras, scans);
  const bool can_be_read_again =
      sources.input.layout != "device" && given.map.empty() && given.save_map.empty();
  if (!(is_late || aftermath.dropped_shutter) || !can_be_read_again || callbacks.stopped())
    return std::nullopt;
  tell(callbacks.event, Event::Level::kInfo,
       aftermath.dropped_shutter
           ? "all is tracked again without a rolling shutter"
           : fmt::format("a rolling shutter was found at frame {}: all is tracked again with it", found_at));
  // What a file says of a lens stands; what was found as if no shutter rolled does not.
  const Rig& rig = sources.lens_is_given() ? sources.rig : first.rig;
  FoundLens lens{rig, sources.prior, sources.origin, !sources.may_be_fisheye, true};
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
  if (posed_count(second) < posed_count(first) || second.segments.size() > first.segments.size())
    return std::nullopt;
  if (aftermath.dropped_shutter) {
    std::ranges::copy_if(first.calibration, std::back_inserter(again->reconstruction.calibration),
                         [](const CalibrationNumber& n) { return n.name.starts_with("readout"); });
  }
  warn({}, dropped_shutter_warning(aftermath.dropped_shutter), &again->report.warnings);
  auto& stages = again->report.stages;
  if (sources.find_ms > 0) stages.insert(stages.begin(), tracked.report.stages.front());
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

}  // namespace

Result<Input> open_inputs(const TrackSettings& settings, bool lens_is_found) {
  return open_input(settings.inputs, {.fps = settings.fps,
                                      .mono = settings.mono,
                                      .ignore_calibration = lens_is_found || !settings.camera.empty(),
                                      .threads = settings.threads,
                                      .range = settings.range});
}

Result<OdometryOptions> odometry_options(const TrackSettings& given) {
  TrackSettings settings = given;
  if (auto r = choose_methods(&settings); !r) return r.error();
  settings.odometry.starts_worlds = !settings.localise;
  return settings.odometry;
}

Result<void> set_rolling_shutter(const std::string& told, Rig* rig, CalibrationPrior* prior) {
  constexpr double kMostMs = 1000;
  const auto scans = [](const Camera& camera) { return camera.shutter.readout > 0; };
  if (told == "auto") {
    if (std::ranges::none_of(rig->cameras, scans)) prior->readout = kUsualReadout;
    return {};
  }
  const std::optional<double> ms = told == "none" ? 0 : parse_number(told);
  if (!ms || !(*ms >= 0 && *ms <= kMostMs)) {
    return bad_input(
        fmt::format("--rolling-shutter = '{}': must be auto, none or 0 to {} milliseconds", told, kMostMs));
  }
  for (Camera& camera : rig->cameras) camera.shutter.readout = *ms / 1000;
  return {};
}

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
    tell(callbacks.event, Event::Level::kWarning, solved->report.warnings[0]);
    return with_costs(*std::move(solved));
  };
  if (solved) return solved_instead();
  Aftermath aftermath;
  Result<TrackResult> tracked = track_cameras(settings, callbacks, watcher, &*maps, &*sources, &aftermath);
  if (!tracked || (found && found->is_guess)) return tracked;
  if (!aftermath.doubts.empty() && !callbacks.stopped()) {
    auto better = with_own_lens(given, callbacks, *sources, aftermath.doubts, &*tracked);
    if (better) return with_costs(*std::move(better));
  }
  if (auto again = with_known_shutter(given, callbacks, *sources, aftermath, *tracked))
    tracked = *std::move(again);
  const std::optional<SeenZoom>& change = aftermath.zoom;
  // A rolling shutter bends the images of a moving camera as a zoom does.
  const bool scans = tracked->reconstruction.rig.cameras[0].shutter.readout > 0;
  std::string& zoom = sources->zoom.warning;
  if (scans) zoom.clear();
  if (change) zoom = zoom_warning(*change);
  const Reconstruction& r = tracked->reconstruction;
  const bool is_short =
      sources->lens_is_given() && r.rig.cameras.size() == 1 && std::ssize(r.keyframes) < kShort;
  if ((sources->zoom.may_be || is_short) && !callbacks.stopped()) {
    if (zoom.empty()) zoom = zoom_warning(zoom_in_map(r));
    const bool may_be_solved =
        sources->zoom.may_be_solved && can_be_solved(settings, std::ssize(r.keyframes));
    if (!zoom.empty() && may_be_solved) solved = solved_zoom(settings, callbacks);
  }
  if (solved && (!scans || is_beyond_shutters(*solved)) &&
      reaches_enough(*solved, posed_count(tracked->reconstruction))) {
    return solved_instead();
  }
  if (!change && scans) zoom.clear();
  tell(callbacks.event, Event::Level::kWarning, zoom);
  if (!zoom.empty()) tracked->report.warnings.push_back(zoom);
  return with_costs(*std::move(tracked));
}

}  // namespace raysfm
