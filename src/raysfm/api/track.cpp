#include "raysfm/api/track.h"

#include <fmt/format.h>
#include <sys/resource.h>

#include <algorithm>
#include <thread>

#include "raysfm/api/view_stream.h"
#include "raysfm/io/camera_file.h"
#include "raysfm/io/frame_source.h"
#include "raysfm/io/image_file.h"
#include "raysfm/odometry/odometry.h"

namespace raysfm {
namespace {

constexpr int kMaxThreads = 1024;
// No frame with fewer corners is ever posed.
constexpr int kMinCorners = 20;

// What a run works on, opened and found to fit together.
struct Sources {
  Input input;
  Rig rig;
  GrayImage mask;  // of the camera; empty: none
};

void tell(const EventSink& event, Event::Level level, const std::string& message) {
  if (event && !message.empty()) event({level, message});
}

Result<Rig> read_rig(const TrackSettings& settings, Input& input, const EventSink& event) {
  if (settings.camera.empty()) {
    if (input.calibration) return *std::move(input.calibration);
    return bad_input(fmt::format("{}: no camera file beside it; give one with --camera", settings.inputs[0]));
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

// The rig without all cameras but the first.
Rig first_camera(Rig rig, const TrackSettings& settings, const EventSink& event) {
  if (rig.cameras.size() > 1 && !settings.mono) {
    tell(event, Event::Level::kWarning,
         fmt::format("{} cameras found; only the first, {}, is used so far", rig.cameras.size(),
                     rig.cameras[0].name));
  }
  rig.cameras.resize(1);
  // The scale of one camera is arbitrary, so a lever arm in metres would mean nothing: the camera is the rig.
  rig.cameras[0].rig_from_cam = Rigid3{};
  return rig;
}

Result<Sources> open_sources(const TrackSettings& settings, const EventSink& event) {
  if (settings.threads < 0 || settings.threads > kMaxThreads) {
    return bad_input(fmt::format("--threads = {}: must be 0 to {}", settings.threads, kMaxThreads));
  }
  if (auto r = validate(settings.odometry); !r) return r.error();
  Result<Input> input = open_input(settings.inputs, {settings.fps, settings.mono, !settings.camera.empty()});
  if (!input) return input.error();
  Result<Rig> rig = read_rig(settings, *input, event);
  if (!rig) return rig.error();
  Sources sources{*std::move(input), first_camera(*std::move(rig), settings, event), {}};

  const Camera& camera = sources.rig.cameras[0];
  std::filesystem::path mask = camera.mask_path;
  if (mask.empty() && sources.input.mask) mask = *sources.input.mask;
  if (!mask.empty()) {
    Result<GrayImage> read = read_mask(mask, camera.width, camera.height);
    if (!read) return read.error();
    sources.mask = *std::move(read);
  }
  return sources;
}

// Where nothing can be seen, that is the reason, and not what came of it later.
void explain_blind_frames(const std::vector<int>& corners, Reconstruction* reconstruction) {
  for (size_t i = 0; i < corners.size(); ++i) {
    PosedFrame& frame = reconstruction->frames[i];
    if (frame.world_from_rig || corners[i] >= kMinCorners) continue;
    frame.reason = fmt::format("too few corners: {}, at least {} are needed", corners[i], kMinCorners);
  }
}

double peak_rss_mib() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

Report make_report(const TrackSettings& settings, const StageTiming& decode, const OdometryTimings& t) {
  Report report;
  report.seed = settings.odometry.seed;
  report.input = settings.inputs;
  report.camera_class = "central";
  report.error = "pixel";
  report.stages = {{"decode", decode},       {"detect", t.detect}, {"start", t.start},
                   {"match", t.match},       {"pose", t.pose},     {"align", t.align},
                   {"keyframe", t.keyframe}, {"adjust", t.adjust}, {"frame", t.frame}};
  return report;
}

}  // namespace

Result<TrackResult> track(const TrackSettings& settings, const TrackCallbacks& callbacks) {
  const Clock::time_point start = Clock::now();
  Result<Sources> sources = open_sources(settings, callbacks.event);
  if (!sources) return sources.error();
  if (callbacks.ready) {
    if (auto r = callbacks.ready(); !r) return r.error();
  }
  const Camera& camera = sources->rig.cameras[0];
  FrameSource& source = *sources->input.streams[camera.stream];
  HarrisOptions harris;
  harris.max_features = settings.odometry.features;
  harris.mask = sources->mask;
  const int threads =
      settings.threads > 0 ? settings.threads : static_cast<int>(std::thread::hardware_concurrency());
  ViewStream stream(source, camera.roi, harris, threads);

  TrackResult out;
  Odometry odometry(sources->rig, settings.odometry, callbacks.event);
  std::vector<int> corners;
  for (;;) {
    out.interrupted = callbacks.stop && callbacks.stop->load();
    if (out.interrupted) break;
    Result<ViewPtr> view = stream.next();
    if (!view) return view.error();
    if (!*view) break;
    corners.push_back((*view)->features.size());
    odometry.process(*view);
    if (callbacks.progress) callbacks.progress({odometry.frames(), source.frame_count(), odometry.posed()});
  }
  if (corners.empty() && !out.interrupted) {
    return bad_input(fmt::format("{}: no frames", source.description()));
  }
  if (!out.interrupted) tell(callbacks.event, Event::Level::kWarning, source.note());

  out.reconstruction = odometry.finish(settings.final == "global");
  explain_blind_frames(corners, &out.reconstruction);
  out.report = make_report(settings, stream.finish(), odometry.timings());
  out.report.wall_s = milliseconds_since(start) / 1000.0;
  out.report.frames_per_second = odometry.frames() / out.report.wall_s;
  out.report.peak_rss_mib = peak_rss_mib();
  return out;
}

}  // namespace raysfm
