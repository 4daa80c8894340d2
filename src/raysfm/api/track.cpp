#include "raysfm/api/track.h"

#include <fmt/format.h>
#include <sys/resource.h>

#include <thread>

#include "raysfm/api/view_stream.h"
#include "raysfm/io/camera_file.h"
#include "raysfm/io/frame_source.h"
#include "raysfm/odometry/odometry.h"

namespace raysfm {
namespace {

Result<Rig> choose_rig(const TrackSettings& settings, Input& input, const EventSink& event) {
  Result<Rig> rig = [&]() -> Result<Rig> {
    if (!settings.camera.empty()) return read_camera_file(settings.camera);
    if (input.calibration) return std::move(*input.calibration);
    return bad_input(fmt::format("{}: no camera file beside it; give one with --camera", settings.inputs[0]));
  }();
  if (!rig || rig->cameras.size() == 1) return rig;
  if (event && !settings.mono) {
    event({Event::Level::kWarning, fmt::format("{} cameras found; only the first, {}, is used so far",
                                               rig->cameras.size(), rig->cameras[0].name)});
  }
  rig->cameras.resize(1);
  rig->cameras[0].rig_from_cam = Rigid3{};
  return rig;
}

// The camera file must be of the images' size; a file that does not say takes it from them.
Result<void> check_size(const View& view, const std::string& source, Camera* camera) {
  const int width = view.image.width(), height = view.image.height();
  if (camera->width == 0 && camera->height == 0) {
    camera->width = width;
    camera->height = height;
  }
  if (camera->width == width && camera->height == height) return {};
  return bad_input(
      fmt::format("{}: images of {}x{} pixels, but camera '{}' has resolution {}x{}; they must be equal",
                  source, width, height, camera->name, camera->width, camera->height));
}

double peak_rss_mib() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

}  // namespace

Result<TrackResult> track(const TrackSettings& settings, const TrackCallbacks& callbacks) {
  const Clock::time_point start = Clock::now();
  if (auto r = validate(settings.odometry); !r) return r.error();
  Result<Input> input = open_input(settings.inputs, {settings.fps, settings.mono});
  if (!input) return input.error();
  Result<Rig> rig = choose_rig(settings, *input, callbacks.event);
  if (!rig) return rig.error();

  FrameSource& source = *input->streams[0];
  const int threads =
      settings.threads > 0 ? settings.threads : static_cast<int>(std::thread::hardware_concurrency());
  HarrisOptions harris;
  harris.max_features = settings.odometry.features;
  ViewStream stream(source, harris, threads);

  TrackResult out;
  std::unique_ptr<Odometry> odometry;
  for (;;) {
    if (callbacks.stop && callbacks.stop->load()) {
      out.interrupted = true;
      break;
    }
    Result<ViewPtr> view = stream.next();
    if (!view) return view.error();
    if (!*view) break;
    if (!odometry) {
      if (auto r = check_size(**view, source.description(), &rig->cameras[0]); !r) return r.error();
      odometry = std::make_unique<Odometry>(*rig, settings.odometry, callbacks.event);
    }
    odometry->process(*view);
    if (callbacks.progress) callbacks.progress({odometry->frames(), source.frame_count(), odometry->posed()});
  }
  if (!odometry) {
    if (!out.interrupted) return bad_input(fmt::format("{}: no frames", source.description()));
    odometry = std::make_unique<Odometry>(*rig, settings.odometry, callbacks.event);
  }
  if (!source.note().empty() && callbacks.event) callbacks.event({Event::Level::kWarning, source.note()});

  out.reconstruction = odometry->finish(settings.final == "global");
  const OdometryTimings t = odometry->timings();
  Report& report = out.report;
  report.seed = settings.odometry.seed;
  report.input = settings.inputs;
  report.camera_class = "central";
  report.error = "pixel";
  report.stages = {{"decode", stream.decode_timing()},
                   {"detect", t.detect},
                   {"start", t.start},
                   {"match", t.match},
                   {"pose", t.pose},
                   {"align", t.align},
                   {"keyframe", t.keyframe},
                   {"adjust", t.adjust},
                   {"frame", t.frame}};
  report.wall_s = milliseconds_since(start) / 1000.0;
  report.frames_per_second = odometry->frames() / report.wall_s;
  report.peak_rss_mib = peak_rss_mib();
  return out;
}

}  // namespace raysfm
