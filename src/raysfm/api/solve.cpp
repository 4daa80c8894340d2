#include "raysfm/api/solve.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "raysfm/api/solve_input.h"
#include "raysfm/api/solve_photos.h"
#include "raysfm/api/solve_tracks.h"
#include "raysfm/core/memory.h"
#include "raysfm/core/thread_pool.h"
#include "raysfm/core/timer.h"
#include "raysfm/results/tracks_file.h"
#include "raysfm/robust/absolute_pose.h"
#include "raysfm/uncalibrated/known_structure.h"
#include "raysfm/uncalibrated/pose_covariance.h"
#include "raysfm/uncalibrated/video_reconstruct.h"

namespace raysfm {
namespace {

constexpr int kMaxFeatures = 100000;
constexpr double kGoodShare = 0.8;  // of the images, with a pose

Result<void> validate(SolveSettings settings) {
  if (auto r = check_allowed(setting_fields(settings)); !r) return r.error();
  if (auto r = check_threads(settings.threads); !r) return r.error();
  if (settings.features < 1 || settings.features > kMaxFeatures) {
    return bad_input(fmt::format("--features = {}: must be 1 to {}", settings.features, kMaxFeatures));
  }
  if (!settings.structure.empty() && !is_tracks_file(settings.input)) {
    return bad_input(fmt::format("--structure = '{}': allowed with a file of tracks only, {} is none",
                                 settings.structure, settings.input));
  }
  if (!(settings.max_error > 0) || !std::isfinite(settings.max_error)) {
    return bad_input(fmt::format("--max-error = {}: must be above 0, in pixels", settings.max_error));
  }
  return {};
}

SolveOptions options_of(const SolveSettings& settings, const std::atomic<bool>* stop) {
  SolveOptions options;
  if (settings.lens == "fixed") options.lens = LensChange::kFixed;
  if (settings.lens == "zoom") options.lens = LensChange::kZoom;
  if (settings.method == "intrinsics-free") options.method = LensMethod::kIntrinsicsFree;
  if (settings.method == "standard") options.method = LensMethod::kStandard;
  if (settings.constraints == "lagrange") options.constraints = ConstraintMethod::kLagrange;
  options.max_error_px = settings.max_error;
  options.seed = settings.seed;
  if (stop) options.go_on = [stop](const IterationInfo&) { return !stop->load(); };
  return options;
}

RadialChoice radial_of(const SolveSettings& settings) {
  if (settings.distortion == "none") return RadialChoice::kNone;
  return settings.distortion == "radial" ? RadialChoice::kFree : RadialChoice::kIfSure;
}

std::string reason_without_pose(int seen, int agreeing) {
  if (seen < kMinPointsPerImage) {
    return fmt::format("too few tracks: {}, at least {} are needed", seen, kMinPointsPerImage);
  }
  return fmt::format("{} of {} tracks agree with a pose, at least {} are needed", agreeing, seen,
                     kMinPointsPerImage);
}

void fill_frames(const SolveInput& input, const UncalibratedReconstruction& found, SolveResult* result) {
  std::vector<int> seen(input.names.size(), 0), agreeing(input.names.size(), 0);
  for (int k = 0; k < input.tracks.size(); ++k) {
    ++seen[input.tracks.image[k]];
    agreeing[input.tracks.image[k]] += found.inlier[k];
  }
  const auto covariances = pose_covariances(input.tracks, found);
  std::optional<Rigid3> world_from_first;
  for (size_t j = 0; j < input.names.size(); ++j) {
    SolvedFrame& frame = result->frames.emplace_back();
    frame.timestamp = input.timestamps[j];
    frame.image_name = input.names[j];
    frame.keyframe = input.keyframe[j];
    frame.width = input.sizes.empty() ? result->width : input.sizes[j].x();
    frame.height = input.sizes.empty() ? result->height : input.sizes[j].y();
    if (!found.image_posed[j]) {
      const bool defective = !input.defects.empty() && !input.defects[j].empty();
      frame.reason = defective ? input.defects[j] : reason_without_pose(seen[j], agreeing[j]);
      continue;
    }
    const Rigid3& cam_from_found = found.scene.cam_from_world[j];
    if (!world_from_first) world_from_first = found.world_is_given ? Rigid3{} : cam_from_found.inverse();
    frame.cam_from_world = cam_from_found * *world_from_first;
    frame.covariance = covariance_in_world(*frame.cam_from_world, covariances[j]);
    frame.lens = found.scene.lenses[j];
    frame.lens.cx -= input.shift(static_cast<int>(j)).x();
    frame.lens.cy -= input.shift(static_cast<int>(j)).y();
    frame.lens_sigma = found.lens_sigma[j];
  }
  const Rigid3 first_from_found = world_from_first ? world_from_first->inverse() : Rigid3{};
  for (size_t i = 0; i < found.scene.points.size(); ++i) {
    if (!found.point_placed[i]) continue;
    SolvedPoint& point = result->points.emplace_back();
    point.position = first_from_found * found.scene.points[i];
    if (!input.rgb.empty()) point.rgb = input.rgb[i];
  }
}

void fill_observations(const SolveInput& input, const UncalibratedReconstruction& found,
                       SolveResult* result) {
  std::vector<int> number(found.point_placed.size(), -1);
  int placed = 0;
  for (size_t i = 0; i < number.size(); ++i) {
    if (found.point_placed[i]) number[i] = placed++;
  }
  for (int k = 0; k < input.tracks.size(); ++k) {
    const int image = input.tracks.image[k];
    if (!found.inlier[k] || !input.keyframe[image]) continue;
    result->observations.push_back(
        {image, number[input.tracks.point[k]], input.tracks.pixel[k] - input.shift(image)});
  }
  std::ranges::stable_sort(result->observations, {}, &SolvedObservation::frame);
}

Result<SolveInput> read_input(const SolveSettings& settings, const SolveCallbacks& callbacks) {
  if (is_tracks_file(settings.input)) return tracks_from_file(settings, callbacks);
  return tracks_from_images(settings, callbacks);
}

// Photos may see one another in any order; images of a video see their neighbours.
Result<UncalibratedReconstruction> reconstruct_input(const SolveInput& input, const SolveSettings& settings,
                                                     const SolveCallbacks& callbacks) {
  const SolveOptions options = options_of(settings, callbacks.stop);
  if (!input.structure.empty()) return reconstruct_known(input.tracks, input.structure, options);
  const bool all = std::ranges::count(input.keyframe, 1) == std::ssize(input.keyframe);
  if (!input.in_order || (all && input.tracks.image_count <= kFewImages)) {
    return reconstruct(input.tracks, options);
  }
  VideoOptions video{.radial = radial_of(settings),
                     .threads = thread_count(settings.threads),
                     .progress = {},
                     .stop = callbacks.stop};
  if (callbacks.progress) {
    video.progress = [&](int posed, int keyframes) { callbacks.progress("key frame", posed, keyframes); };
  }
  return reconstruct_video(input.tracks, input.keyframe, options, video);
}

// 0 without a reconstruction.
double posed_share(const Result<UncalibratedReconstruction>& found) {
  if (!found) return 0;
  const auto posed = std::ranges::count(found->image_posed, 1);
  return static_cast<double>(posed) / static_cast<double>(found->image_posed.size());
}

SolveResult result_of(const SolveInput& input, UncalibratedReconstruction found) {
  SolveResult result;
  result.width = static_cast<int>(input.tracks.image_size.x());
  result.height = static_cast<int>(input.tracks.image_size.y());
  if (found.lens_sigma.size() != input.names.size()) {
    found.lens_sigma.assign(input.names.size(), LensVector::Constant(INFINITY));
  }
  fill_frames(input, found, &result);
  fill_observations(input, found, &result);
  result.zooming = found.zooming;
  result.lens_evidence = found.lens_evidence;
  result.degenerate = found.degenerate;
  result.radial = found.radial;
  result.radial_sigma = found.radial_sigma;
  result.world_is_given = found.world_is_given;
  result.rms_px = found.rms_px;
  result.stages = input.stages;
  for (const auto& stage : found.stages) result.stages.push_back(stage);
  std::copy_n(found.start_images, 2, result.start_frames);
  result.start_inliers = found.start_inliers;
  result.adjustment = std::move(found.adjustment);
  result.interrupted = input.interrupted;
  return result;
}

void warn(const SolveResult& result, const EventSink& event) {
  if (!result.degenerate.empty()) {
    tell(event, Event::Level::kWarning,
         fmt::format("the focal lengths are not determined by these images: {}", result.degenerate));
  }
  const auto lost = std::ranges::count_if(result.frames, [](const auto& f) { return !f.cam_from_world; });
  if (lost > 0) {
    tell(event, Event::Level::kWarning,
         fmt::format("{} of {} frames have no pose", lost, result.frames.size()));
  }
}

}  // namespace

std::vector<SettingField> setting_fields(SolveSettings& s) {
  return {
      {"lens", "whether the lens zooms; auto lets the images decide", &s.lens, {"auto", "fixed", "zoom"}},
      {"distortion",
       "radial distortion of a video's lens; auto estimates it and keeps it where it is sure",
       &s.distortion,
       {"auto", "none", "radial"}},
      {"method",
       "adjustment: intrinsics-free, with the lenses as unknowns, or both in this order",
       &s.method,
       {"intrinsics-free", "standard", "polished"}},
      {"constraints",
       "how the intrinsics-free adjustment imposes what is known of the lenses",
       &s.constraints,
       {"weights", "lagrange"}},
      {"images",
       "what images are: a video, or photos, every one of which is compared with every other; auto lets them "
       "decide",
       &s.images,
       {"auto", "video", "photos"}},
      {"size", "WIDTHxHEIGHT of the images, for tracks in a file", &s.size, {}},
      {"structure",
       "CSV of known positions of the points of a file of tracks: point,x,y,z",
       &s.structure,
       {}},
      {"fps", "frames per second of inputs without timestamps", &s.fps, {}},
      {"features", "corners in an image", &s.features, {}},
      {"max-error", "pixels by which an observation may be off", &s.max_error, {}},
      {"seed", "seed of every random choice", &s.seed, {}},
      {"threads", "worker threads; 0 for as many as the machine has", &s.threads, {}},
  };
}

Result<SolveResult> solve(const SolveSettings& settings, const SolveCallbacks& callbacks) {
  const Clock::time_point start = Clock::now();
  if (auto r = validate(settings); !r) return r.error();
  const auto stopped = [&] { return callbacks.stop && callbacks.stop->load(); };
  SolveCallbacks once = callbacks;
  bool is_ready = false;
  once.ready = [&]() -> Result<void> {
    if (std::exchange(is_ready, true) || !callbacks.ready) return {};
    return callbacks.ready();
  };
  Result<SolveInput> input = read_input(settings, once);
  if (!input) return input.error();
  const double read_s = milliseconds_since(start) / 1000.0;
  Result<UncalibratedReconstruction> found = reconstruct_input(*input, settings, callbacks);
  // A few images that do not go well as a video may go better as photos.
  if (settings.images == "auto" && !is_tracks_file(settings.input) && input->in_order &&
      input->tracks.image_count <= kFewImages && !stopped() && posed_share(found) < kGoodShare) {
    tell(callbacks.event, Event::Level::kInfo,
         found ? "as a video few of the images have a pose, now tried as photos"
               : "not solved as a video, now tried as photos: " + found.error().message);
    Result<SolveInput> photos = tracks_from_photos(settings, once);
    if (!photos) return photos.error();
    Result<UncalibratedReconstruction> other = reconstruct_input(*photos, settings, callbacks);
    if (posed_share(other) >= posed_share(found)) {
      input = std::move(photos);
      found = std::move(other);
    }
  }
  if (!found) return Error{found.error().kind, fmt::format("{}: {}", settings.input, found.error().message)};
  SolveResult result = result_of(*input, *std::move(found));
  warn(result, callbacks.event);
  result.interrupted = result.interrupted || stopped();
  result.read_s = read_s;
  result.wall_s = milliseconds_since(start) / 1000.0;
  result.solve_s = result.wall_s - read_s;
  result.peak_rss_mib = peak_rss_mib();
  return result;
}

}  // namespace raysfm
