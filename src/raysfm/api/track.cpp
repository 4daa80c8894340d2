#include "raysfm/api/track.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>

#include "raysfm/api/config.h"
#include "raysfm/api/view_stream.h"
#include "raysfm/camera/camera_class.h"
#include "raysfm/core/memory.h"
#include "raysfm/core/thread_pool.h"
#include "raysfm/io/camera_file.h"
#include "raysfm/io/frame_source.h"
#include "raysfm/io/image_file.h"
#include "raysfm/odometry/extrinsics_check.h"
#include "raysfm/odometry/odometry.h"
#include "raysfm/odometry/sight_mask.h"

namespace raysfm {
namespace {

// No frame with fewer corners is ever posed.
constexpr int kMinCorners = 20;

// What a run works on, opened and found to fit together.
struct Sources {
  Input input;
  Rig rig;
  std::vector<GrayImage> masks;  // by camera; empty: it sees the scene everywhere
};

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

Rig cameras_in_use(Rig rig, const TrackSettings& settings) {
  if (settings.mono) rig.cameras.resize(1);
  // One camera does not tell where the rig's frame is: a lever arm in metres would mean nothing in a world of
  // arbitrary scale. The camera is the rig.
  if (rig.cameras.size() == 1) rig.cameras[0].rig_from_cam = Rigid3{};
  return rig;
}

// Where the camera sees the scene, as the user says and its model knows.
Result<GrayImage> mask_of(const Camera& camera, const Input& input) {
  std::filesystem::path path = camera.mask_path;
  if (path.empty() && input.mask && input.streams.size() == 1) path = *input.mask;
  GrayImage mask;
  if (!path.empty()) {
    Result<GrayImage> read = read_mask(path, camera.width, camera.height);
    if (!read) return read.error();
    mask = *std::move(read);
  }
  return sight_mask(camera, std::move(mask));
}

Result<Sources> open_sources(const TrackSettings& settings, const EventSink& event) {
  if (auto r = check_threads(settings.threads); !r) return r.error();
  if (auto r = validate(settings.odometry); !r) return r.error();
  Result<Input> input = open_input(settings.inputs, {.fps = settings.fps,
                                                     .mono = settings.mono,
                                                     .ignore_calibration = !settings.camera.empty(),
                                                     .threads = settings.threads});
  if (!input) return input.error();
  Result<Rig> rig = read_rig(settings, *input, event);
  if (!rig) return rig.error();
  Sources sources{*std::move(input), cameras_in_use(*std::move(rig), settings), {}};
  if (auto r = validate_error(sources.rig, settings.odometry.error); !r) return r.error();
  for (const Camera& camera : sources.rig.cameras) {
    Result<GrayImage> mask = mask_of(camera, sources.input);
    if (!mask) return mask.error();
    sources.masks.push_back(*std::move(mask));
  }
  return sources;
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
  const auto choose = [](const auto& table, const char* flag, const std::string& name,
                         auto* value) -> Result<void> {
    for (const auto& [known, method] : table) {
      if (known == name) return *value = method, Result<void>();
    }
    return bad_input(fmt::format("{} = {}: unknown; see --help", flag, name));
  };
  if (auto r = choose(kErrors, "--error", settings->error, &settings->odometry.error); !r) return r;
  return choose(kStarts, "--start", settings->start, &settings->odometry.start);
}

// A segment that lasted until a signal came did not end for want of input.
void explain_interruption(Reconstruction* reconstruction) {
  for (Segment& segment : reconstruction->segments) {
    if (segment.reason == "end of input") segment.reason = "interrupted";
  }
}

// What the images of a frame show.
struct Sight {
  std::optional<int> corners;  // not counted where the frame is posed without
  int brightest = 255;         // level of a pixel; told only where there are few corners
  std::string defect;
};

// Levels up to this are nearly black. Twelve bits in a file of sixteen end at 15.
constexpr int kBlack = 15;

// Where nothing can be seen, that is the reason, and not what came of it later.
void explain_blind_frames(const std::vector<Sight>& sights, Reconstruction* reconstruction) {
  for (size_t i = 0; i < sights.size(); ++i) {
    PosedFrame& frame = reconstruction->frames[i];
    const int corners = sights[i].corners.value_or(kMinCorners);
    if (frame.world_from_rig || !sights[i].defect.empty() || corners >= kMinCorners) continue;
    frame.reason = fmt::format("too few corners: {}, at least {} are needed", corners, kMinCorners);
    if (sights[i].brightest > kBlack) continue;
    frame.reason +=
        fmt::format("; the picture is nearly black, its brightest pixel is {} of 255", sights[i].brightest);
  }
}

Report make_report(const TrackSettings& settings, const Odometry& odometry, const StageTiming& decode) {
  const OdometryTimings t = odometry.timings();
  Report report;
  report.seed = settings.odometry.seed;
  report.input = settings.inputs;
  report.camera_class = to_string(camera_class(odometry.rig().rig()));
  report.error = odometry.rig().angular() ? "angular" : "pixel";
  report.stages = {{"decode", decode},       {"detect", t.detect}, {"start", t.start},
                   {"match", t.match},       {"pose", t.pose},     {"align", t.align},
                   {"keyframe", t.keyframe}, {"adjust", t.adjust}, {"frame", t.frame}};
  return report;
}

std::vector<CameraInput> camera_inputs(const Sources& sources, const TrackSettings& settings) {
  const int count = static_cast<int>(sources.rig.cameras.size());
  std::vector<CameraInput> inputs;
  for (int c = 0; c < count; ++c) {
    CameraInput& input = inputs.emplace_back();
    input.stream = sources.rig.cameras[c].stream;
    input.roi = sources.rig.cameras[c].roi;
    // More cameras see more, but part of it more than once.
    input.harris.max_features = 2 * settings.odometry.features / (count + 1);
    input.harris.mask = sources.masks[c].view();
  }
  return inputs;
}

// Where the calibration came from, for messages.
std::string camera_source(const TrackSettings& settings, const Input& input) {
  if (!settings.camera.empty()) return settings.camera;
  return input.calibration_file ? input.calibration_file->string() : settings.inputs[0];
}

int brightest(const View& view) {
  int level = 0;
  for (const CameraView& camera : view.cameras) {
    const GrayView image = camera.octaves->at(camera.octaves->first());
    for (int y = 0; y < image.height; ++y) {
      level = std::max<int>(level, *std::max_element(image.row(y), image.row(y) + image.width));
    }
  }
  return level;
}

Sight sight_of(const View& view) {
  Sight sight;
  sight.defect = view.defect;
  if (!view.detected()) return sight;
  int corners = 0;
  for (const CameraView& camera : view.cameras) corners += camera.features.size();
  sight.corners = corners;
  if (corners < kMinCorners && sight.defect.empty()) sight.brightest = brightest(view);
  return sight;
}

}  // namespace

Result<TrackResult> track(const TrackSettings& given, const TrackCallbacks& callbacks) {
  const Clock::time_point start = Clock::now();
  TrackSettings settings = given;
  if (auto r = choose_methods(&settings); !r) return r.error();
  Result<Sources> sources = open_sources(settings, callbacks.event);
  if (!sources) return sources.error();
  if (callbacks.ready) {
    if (auto r = callbacks.ready(); !r) return r.error();
  }
  const int threads = thread_count(settings.threads);
  ViewStream stream(sources->input.streams, camera_inputs(*sources, settings), threads);
  FrameSource& source = *sources->input.streams[0];

  TrackResult out;
  Odometry odometry(sources->rig, settings.odometry, callbacks.event, &stream.maker());
  std::vector<Sight> sights;
  bool checked = false;
  for (;;) {
    out.interrupted = callbacks.stop && callbacks.stop->load();
    if (out.interrupted) break;
    Result<ViewPtr> view = stream.next();
    if (!view) return view.error();
    if (!*view) break;
    if (!checked && (*view)->defect.empty()) {
      checked = true;
      if (auto problem = opposite_extrinsics(odometry.rig(), **view)) {
        return bad_input(fmt::format("{}: {}", camera_source(settings, sources->input), *problem));
      }
    }
    odometry.process(*view);
    stream.detect_ahead(!odometry.tracking());
    if (!odometry.tracking()) view = stream.maker().detected(*view);
    sights.push_back(sight_of(**view));
    if (callbacks.progress) callbacks.progress({odometry.frames(), source.frame_count(), odometry.posed()});
  }
  if (sights.empty() && !out.interrupted) {
    return bad_input(fmt::format("{}: no frames", source.description()));
  }
  if (!out.interrupted) {
    for (const auto& s : sources->input.streams) tell(callbacks.event, Event::Level::kWarning, s->note());
    tell(callbacks.event, Event::Level::kWarning, stream.note());
  }

  out.reconstruction = odometry.finish(settings.final == "global");
  explain_blind_frames(sights, &out.reconstruction);
  if (out.interrupted) explain_interruption(&out.reconstruction);
  out.report = make_report(settings, odometry, stream.finish());
  out.report.interrupted = out.interrupted;
  out.report.frames_in_input = source.frame_count();
  out.report.wall_s = milliseconds_since(start) / 1000.0;
  out.report.frames_per_second = odometry.frames() / out.report.wall_s;
  out.report.peak_rss_mib = peak_rss_mib();
  return out;
}

}  // namespace raysfm
