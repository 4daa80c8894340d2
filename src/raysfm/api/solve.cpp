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
#include "raysfm/scene/worlds.h"
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

SolveOptions options_of(const SolveSettings& settings) {
  SolveOptions options;
  if (settings.lens == "fixed") options.lens = LensChange::kFixed;
  if (settings.lens == "zoom") options.lens = LensChange::kZoom;
  if (settings.method == "intrinsics-free") options.method = LensMethod::kIntrinsicsFree;
  if (settings.method == "standard") options.method = LensMethod::kStandard;
  if (settings.constraints == "lagrange") options.constraints = ConstraintMethod::kLagrange;
  options.max_error_px = settings.max_error;
  options.seed = settings.seed;
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

bool same_but_for_rounding(const LensVector& a, const LensVector& b) {
  constexpr double kRounding = 1e-12;
  for (int i = 0; i < a.size(); ++i) {
    if (a[i] != b[i] && !(std::abs(a[i] - b[i]) <= kRounding * std::abs(a[i]))) return false;
  }
  return true;
}

// The lens of an image, in an image of its own size.
FrameLens lens_of_image(const SolveInput& input, const UncalibratedReconstruction& found, int image) {
  const Eigen::Vector2i size =
      input.sizes.empty() ? input.tracks.image_size.cast<int>().eval() : input.sizes[image];
  Lens lens = found.scene.lenses[image];
  lens.cx -= input.shift(image).x();
  lens.cy -= input.shift(image).y();
  FrameLens made = frame_lens(lens, found.radial);
  made.camera.width = size.x();
  made.camera.height = size.y();
  made.sigma = found.lens_sigma[image];
  made.radial_sigma = found.radial_sigma;
  return made;
}

// The number of the lens of an image among `lenses`. One that does not zoom is that of all images that are of
// one size and tell it equally well.
int place_lens(const SolveInput& input, const UncalibratedReconstruction& found, int image,
               std::vector<FrameLens>* lenses) {
  FrameLens lens = lens_of_image(input, found, image);
  for (size_t i = 0; !found.zooming && i < lenses->size(); ++i) {
    const FrameLens& other = (*lenses)[i];
    if (other.camera.width == lens.camera.width && other.camera.height == lens.camera.height &&
        same_but_for_rounding(lens_of(other)->vector(), lens_of(lens)->vector()) &&
        same_but_for_rounding(other.sigma, lens.sigma)) {
      return static_cast<int>(i);
    }
  }
  lenses->push_back(std::move(lens));
  return static_cast<int>(lenses->size()) - 1;
}

void fill_frames(const SolveInput& input, const UncalibratedReconstruction& found,
                 const Rigid3& found_from_world, Reconstruction* r) {
  std::vector<int> seen(input.names.size(), 0), agreeing(input.names.size(), 0);
  for (int k = 0; k < input.tracks.size(); ++k) {
    ++seen[input.tracks.image[k]];
    agreeing[input.tracks.image[k]] += found.inlier[k];
  }
  const auto covariances = pose_covariances(input.tracks, found);
  for (size_t j = 0; j < input.names.size(); ++j) {
    PosedFrame& frame = r->frames.emplace_back();
    frame.timestamp = input.timestamps[j];
    frame.image_name = input.names[j];
    if (!found.image_posed[j]) {
      const bool defective = !input.defects.empty() && !input.defects[j].empty();
      frame.reason = defective ? input.defects[j] : reason_without_pose(seen[j], agreeing[j]);
      continue;
    }
    const Rigid3 cam_from_world = found.scene.cam_from_world[j] * found_from_world;
    frame.segment = 0;
    frame.world_from_rig = cam_from_world.inverse();
    // The upper triangle is what the file holds.
    frame.covariance = covariance_in_world(cam_from_world, covariances[j]).selfadjointView<Eigen::Upper>();
    frame.lens = place_lens(input, found, static_cast<int>(j), &r->lenses);
  }
}

// The observations that agree, of key frames with a pose.
void fill_map(const SolveInput& input, const UncalibratedReconstruction& found,
              const Rigid3& world_from_found, Reconstruction* r) {
  std::vector<int> number(found.point_placed.size(), -1);
  for (size_t i = 0; i < number.size(); ++i) {
    if (!found.point_placed[i]) continue;
    number[i] = static_cast<int>(r->points.size());
    MapPoint& point = r->points.emplace_back();
    point.position = world_from_found * found.scene.points[i];
    if (!input.rgb.empty()) point.rgb = input.rgb[i];
  }
  std::vector<std::vector<Observation>> of_image(input.names.size());
  for (int k = 0; k < input.tracks.size(); ++k) {
    const int image = input.tracks.image[k];
    if (!found.inlier[k]) continue;
    of_image[image].push_back({number[input.tracks.point[k]], 0, input.tracks.pixel[k] - input.shift(image)});
  }
  for (int j = 0; j < static_cast<int>(of_image.size()); ++j) {
    if (!input.keyframe[j] || !found.image_posed[j]) continue;
    const auto first = static_cast<int>(r->observations.size());
    r->observations.insert(r->observations.end(), of_image[j].begin(), of_image[j].end());
    r->keyframes.push_back({j, first, static_cast<int>(r->observations.size())});
  }
}

// The one world, from the first pose to the last.
void fill_segment(const UncalibratedReconstruction& found, bool interrupted, Reconstruction* r) {
  const auto has_pose = [](const PosedFrame& frame) { return frame.world_from_rig.has_value(); };
  const auto first = std::ranges::find_if(r->frames, has_pose);
  if (first == r->frames.end()) return;
  const auto end = std::find_if(r->frames.rbegin(), r->frames.rend(), has_pose).base();
  const std::string last_reason = interrupted ? "interrupted" : "end of input";
  r->segments.push_back({static_cast<int>(first - r->frames.begin()),
                         static_cast<int>(end - r->frames.begin()) - 1,
                         end == r->frames.end() ? last_reason : end->reason,
                         found.world_is_given,
                         {}});
  r->starts.push_back(
      {found.world_is_given ? "known structure" : "fundamental matrix and absolute dual quadric",
       {found.start_images[0], found.start_images[1]},
       found.start_inliers});
}

Result<SolveInput> read_input(const SolveSettings& settings, const SolveCallbacks& callbacks) {
  if (is_tracks_file(settings.input)) return tracks_from_file(settings, callbacks);
  return tracks_from_images(settings, callbacks);
}

// Photos may see one another in any order; images of a video see their neighbours.
Result<UncalibratedReconstruction> reconstruct_input(const SolveInput& input, const SolveSettings& settings,
                                                     const SolveCallbacks& callbacks) {
  const SolveOptions options = options_of(settings);
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

Reconstruction reconstruction_of(const SolveInput& input, UncalibratedReconstruction& found,
                                 bool interrupted) {
  if (found.lens_sigma.size() != input.names.size()) {
    found.lens_sigma.assign(input.names.size(), LensVector::Constant(INFINITY));
  }
  Reconstruction r;
  r.origin = Origin::kSolve;
  r.metric_scale = found.world_is_given;
  r.rms_reprojection_px = found.rms_px;
  const auto first = std::ranges::find(found.image_posed, 1);
  Rigid3 found_from_world;
  if (!found.world_is_given && first != found.image_posed.end()) {
    found_from_world = found.scene.cam_from_world[first - found.image_posed.begin()].inverse();
  }
  fill_frames(input, found, found_from_world, &r);
  fill_map(input, found, found_from_world.inverse(), &r);
  fill_segment(found, interrupted, &r);
  return r;
}

Report report_of(const SolveInput& input, const UncalibratedReconstruction& found,
                 const SolveSettings& settings) {
  const LmSummary& lm = found.adjustment.lm;
  Report report;
  report.seed = settings.seed;
  report.input = {settings.input};
  report.camera_class = "central";
  report.error = "pixel";
  report.stages = input.stages;
  report.stages.insert(report.stages.end(), found.stages.begin(), found.stages.end());
  report.lens = {found.zooming, found.lens_evidence, found.degenerate,
                 static_cast<int>(input.tracks.image_size.x()),
                 static_cast<int>(input.tracks.image_size.y())};
  report.adjustment = {.method = settings.method,
                       .initial_cost = lm.initial_cost,
                       .final_cost = lm.final_cost,
                       .iterations = lm.iterations,
                       .termination = std::string(to_string(lm.termination))};
  return report;
}

void warn(const SolveResult& result, const EventSink& event) {
  if (!result.report.lens->degenerate.empty()) {
    tell(event, Event::Level::kWarning,
         fmt::format("the focal lengths are not determined by these images: {}",
                     result.report.lens->degenerate));
  }
  const size_t frames = result.reconstruction.frames.size();
  const size_t lost = frames - posed_count(result.reconstruction);
  if (lost > 0) {
    tell(event, Event::Level::kWarning, fmt::format("{} of {} frames have no pose", lost, frames));
  }
}

void set_times(Clock::time_point start, double read_s, SolveResult* result) {
  Report& report = result->report;
  report.wall_s = milliseconds_since(start) / 1000.0;
  report.adjustment->read_s = read_s;
  report.adjustment->solve_s = report.wall_s - read_s;
  report.frames_per_second = static_cast<double>(result->reconstruction.frames.size()) / report.wall_s;
  report.peak_rss_mib = peak_rss_mib();
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
      input->tracks.image_count <= kFewImages && !input->interrupted && posed_share(found) < kGoodShare) {
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
  const bool interrupted = input->interrupted || (callbacks.stop && callbacks.stop->load());
  SolveResult result{reconstruction_of(*input, *found, interrupted), report_of(*input, *found, settings)};
  result.report.interrupted = interrupted;
  warn(result, callbacks.event);
  set_times(start, read_s, &result);
  return result;
}

}  // namespace raysfm
