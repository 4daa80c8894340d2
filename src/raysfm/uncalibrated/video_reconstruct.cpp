#include "raysfm/uncalibrated/video_reconstruct.h"

#include <algorithm>
#include <cmath>
#include <mutex>
#include <optional>
#include <utility>

#include "raysfm/core/median.h"
#include "raysfm/projective/degeneracy.h"
#include "raysfm/projective/video_motion.h"
#include "raysfm/uncalibrated/dense_groups.h"
#include "raysfm/uncalibrated/lens_choice.h"
#include "raysfm/uncalibrated/one_lens.h"
#include "raysfm/uncalibrated/video_growth.h"
#include "raysfm/uncalibrated/video_radial.h"

namespace raysfm {
namespace {

constexpr int kStartImages = 16;                    // key frames
constexpr int kStarts = 5;                          // stretches tried
constexpr int kGroupImages = 24, kPhotoGroups = 3;  // of photos
constexpr double kSureFocal = 0.01;

std::vector<int> marked(std::span<const uint8_t> marks) {
  std::vector<int> numbers;
  for (size_t j = 0; j < marks.size(); ++j) {
    if (marks[j]) numbers.push_back(static_cast<int>(j));
  }
  return numbers;
}

// The stretch [first, last) of the key frames alone.
struct Stretch {
  PointTracks tracks;
  std::vector<int> images, points;  // in the whole, by index in the stretch
  std::vector<int> observations;
};

Stretch cut(const PointTracks& tracks, std::span<const int> images) {
  Stretch stretch;
  stretch.images.assign(images.begin(), images.end());
  std::vector<int> image_number(tracks.image_count, -1), seen(tracks.point_count, 0);
  std::vector<int> point_number(tracks.point_count, -1);
  for (size_t j = 0; j < images.size(); ++j) image_number[images[j]] = static_cast<int>(j);
  for (int k = 0; k < tracks.size(); ++k) seen[tracks.point[k]] += image_number[tracks.image[k]] >= 0;
  for (int i = 0; i < tracks.point_count; ++i) {
    if (seen[i] < 3) continue;
    point_number[i] = static_cast<int>(stretch.points.size());
    stretch.points.push_back(i);
  }
  stretch.tracks.image_count = static_cast<int>(images.size());
  stretch.tracks.point_count = static_cast<int>(stretch.points.size());
  stretch.tracks.image_size = tracks.image_size;
  for (int k = 0; k < tracks.size(); ++k) {
    const int image = image_number[tracks.image[k]], point = point_number[tracks.point[k]];
    if (image < 0 || point < 0) continue;
    stretch.tracks.add(image, point, tracks.pixel[k]);
    stretch.observations.push_back(k);
  }
  return stretch;
}

UncalibratedReconstruction put_into(const PointTracks& tracks, const Stretch& stretch,
                                    const UncalibratedReconstruction& part) {
  UncalibratedReconstruction whole = part;
  whole.scene.cam_from_world.assign(tracks.image_count, Rigid3{});
  whole.scene.lenses.assign(tracks.image_count, Lens{});
  whole.scene.points.assign(tracks.point_count, Eigen::Vector3d::Zero());
  whole.image_posed.assign(tracks.image_count, 0);
  whole.point_placed.assign(tracks.point_count, 0);
  whole.inlier.assign(tracks.size(), 0);
  for (size_t j = 0; j < stretch.images.size(); ++j) {
    whole.scene.cam_from_world[stretch.images[j]] = part.scene.cam_from_world[j];
    whole.scene.lenses[stretch.images[j]] = part.scene.lenses[j];
    whole.image_posed[stretch.images[j]] = part.image_posed[j];
  }
  for (size_t i = 0; i < stretch.points.size(); ++i) {
    whole.scene.points[stretch.points[i]] = part.scene.points[i];
    whole.point_placed[stretch.points[i]] = part.point_placed[i];
  }
  for (size_t k = 0; k < stretch.observations.size(); ++k) {
    whole.inlier[stretch.observations[k]] = part.inlier[k];
  }
  for (int& image : whole.start_images) image = image < 0 ? -1 : stretch.images[image];
  return whole;
}

// How well a start knows its focal lengths and how much of its stretch it reached; the less the better.
double doubt(const UncalibratedReconstruction& start) {
  std::vector<double> sigmas;
  int posed = 0;
  for (size_t j = 0; j < start.image_posed.size(); ++j) {
    if (!start.image_posed[j]) continue;
    ++posed;
    const double sigma = start.lens_sigma.empty() ? INFINITY : start.lens_sigma[j][0];
    sigmas.push_back(std::min(1e3, sigma / start.scene.lenses[j].fx));
  }
  if (posed < 3) return INFINITY;
  return median_of(&sigmas) * double(start.image_posed.size()) / posed;
}

// Images to start from: stretches of key frames, or groups of photos.
std::vector<std::vector<int>> start_images(const PointTracks& tracks, const std::vector<int>& keyframes,
                                           bool in_order) {
  if (!in_order) return dense_groups(tracks, kGroupImages, kPhotoGroups);
  const int count = static_cast<int>(keyframes.size());
  const int length = std::min(count, kStartImages);
  const int starts = count > length ? std::clamp(2 * count / length, 2, kStarts) : 1;
  std::vector<std::vector<int>> stretches;
  for (int s = 0; s < starts; ++s) {
    const auto first = keyframes.begin() + (starts > 1 ? (count - length) * s / (starts - 1) : 0);
    stretches.emplace_back(first, first + length);
  }
  return stretches;
}

// The best of a few starts.
Result<UncalibratedReconstruction> find_start(const PointTracks& tracks, const std::vector<int>& keyframes,
                                              const SolveOptions& options, const GrowthControl& control,
                                              bool in_order) {
  SolveOptions of_start = options;
  of_start.radial = RadialChoice::kNone;  // it is looked for when all is there
  of_start.lens_of_image.clear();         // and so are these
  Result<UncalibratedReconstruction> best =
      no_reconstruction("start: no stretch of the video determines one");
  double least = INFINITY;
  bool first = true;
  for (const std::vector<int>& images : start_images(tracks, keyframes, in_order)) {
    if (!(least > kSureFocal) || (!first && control.stopped())) break;
    first = false;
    const Stretch stretch = cut(tracks, images);
    const auto part = reconstruct(stretch.tracks, of_start);
    if (options.stopped() && !best) return no_reconstruction("interrupted");
    if (!part && !best && !std::isfinite(least)) best = part.error();
    if (!part || !(doubt(*part) < least)) continue;
    least = doubt(*part);
    best = put_into(tracks, stretch, *part);
  }
  return best;
}

// The lens with which an image was taken, or one taken near it, -1 without one.
int nearest_with_lens(const UncalibratedReconstruction& r, int image) {
  for (int d = 0; d < static_cast<int>(r.image_posed.size()); ++d) {
    for (const int j : {image - d, image + d}) {
      if (j >= 0 && j < static_cast<int>(r.image_posed.size()) && r.image_posed[j]) return j;
    }
  }
  return -1;
}

// All tracks as lenses without distortion would show them; what cannot be told lies where nothing agrees.
PointTracks ideal_tracks(const PointTracks& tracks, const UncalibratedReconstruction& r) {
  if (r.radial.none()) return tracks;
  std::vector<Lens> lenses;
  for (int j = 0; j < tracks.image_count; ++j) {
    const int nearest = nearest_with_lens(r, j);
    lenses.push_back(nearest < 0 ? Lens{} : r.scene.lenses[nearest]);
  }
  std::vector<double> weights(tracks.size(), 1);
  return without_distortion(tracks, lenses, r.radial, &weights);
}

// Whether a distortion is there: far surer than noise, and of an effect that can be seen.
bool is_sure(const PointTracks& tracks, const UncalibratedReconstruction& r, const RadialEstimate& estimate) {
  constexpr double kSigmas = 15;  // those of the estimate are too small where errors are alike along a track
  constexpr double kLeastEffect = 0.5;  // pixels, at the corners of the image
  std::vector<double> focal;
  for (int j = 0; j < tracks.image_count; ++j) {
    if (r.image_posed[j]) focal.push_back(r.scene.lenses[j].fx);
  }
  if (focal.empty()) return false;
  const double middle = median_of(&focal);
  const double corner = 0.5 * tracks.image_size.norm();
  return std::abs(estimate.k1) > kSigmas * estimate.sigma &&
         std::abs(estimate.k1) * std::pow(corner, 3) > kLeastEffect * middle * middle;
}

// The end of zooming lenses, or by the intrinsics-free adjustment: the distortion of a video is looked for
// beside it.
Result<void> finish_lenses(const PointTracks& tracks, std::span<const uint8_t> keyframe,
                           const SolveOptions& options, const GrowthControl& control, VideoGrowth* growth,
                           UncalibratedReconstruction* result) {
  const bool photos = options.errors == ErrorRelation::kWithinImages;
  if (photos || options.radial == RadialChoice::kNone || control.stopped()) return growth->finish();
  std::optional<RadialEstimate> estimate = growth->radial();
  if (!estimate || control.stopped() ||
      (options.radial == RadialChoice::kIfSure && !is_sure(tracks, *result, *estimate))) {
    return growth->finish();
  }
  result->scene = std::move(estimate->scene);
  result->radial.k1 = estimate->k1;
  const PointTracks ideal = ideal_tracks(tracks, *result);
  VideoGrowth again(ideal, keyframe, options, result);
  if (auto r = again.grow(control); !r) return r;  // what the distortion kept out may come in now
  if (auto r = again.finish(); !r) return r;
  result->radial_sigma.k1 = estimate->sigma;
  for (int j = 0; j < tracks.image_count; ++j) {
    LensVector& sigma = result->lens_sigma[j];
    sigma = (sigma.cwiseAbs2() + (estimate->sigma * estimate->lens_by_k1[j]).cwiseAbs2()).cwiseSqrt();
  }
  return {};
}

// The end of one lens: adjusted together with its distortion.
Result<void> finish_one_lens(const PointTracks& tracks, std::span<const uint8_t> keyframe,
                             const SolveOptions& options, const GrowthControl& control, VideoGrowth* growth,
                             UncalibratedReconstruction* result) {
  const auto stopped = [&] { return control.stopped() || options.stopped(); };
  if (stopped()) return growth->finish();
  for (int round = 0; round < 2; ++round) {
    if (round > 0) {  // what the distortion kept out may come in now
      if (result->radial.none() || stopped()) break;
      const PointTracks ideal = ideal_tracks(tracks, *result);
      if (auto r = VideoGrowth(ideal, keyframe, options, result).grow(control); !r) return r;
    }
    const ScopedTimer timer(result->stages["distortion"]);
    auto lens = adjust_one_lens_to_the_end(tracks, result->inlier, options, result->scene, result->radial);
    if (!lens) return lens.error();
    take_lens(tracks, keyframe, options, std::move(*lens), result);
  }
  return {};
}

// Adjusts to the end, with the distortion where there is one.
Result<void> finish(const PointTracks& tracks, std::span<const uint8_t> keyframe, const SolveOptions& options,
                    const GrowthControl& control, VideoGrowth* growth, UncalibratedReconstruction* result) {
  return adjusts_one_lens(options, *result)
             ? finish_one_lens(tracks, keyframe, options, control, growth, result)
             : finish_lenses(tracks, keyframe, options, control, growth, result);
}

// Goes on from a reconstruction of a part.
Result<UncalibratedReconstruction> extend(const PointTracks& tracks, std::span<const uint8_t> keyframe,
                                          const SolveOptions& options, const GrowthControl& control,
                                          const UncalibratedReconstruction& start) {
  UncalibratedReconstruction result = start;
  result.zooming = options.lens == LensChange::kZoom;
  if (result.zooming) result.radial = {};  // looked for anew
  const PointTracks ideal = ideal_tracks(tracks, result);
  // What is between key frames is posed again when all is there.
  for (int k = 0; k < tracks.size(); ++k) result.inlier[k] &= keyframe[tracks.image[k]];
  for (size_t j = 0; j < keyframe.size(); ++j) result.image_posed[j] &= keyframe[j];
  VideoGrowth growth(ideal, keyframe, options, &result);
  if (auto grown = growth.grow(control); !grown) return grown.error();
  if (auto r = finish(tracks, keyframe, options, control, &growth, &result); !r) return r.error();
  return result;
}

Result<UncalibratedReconstruction> build(const PointTracks& tracks, std::span<const uint8_t> keyframe,
                                         const SolveOptions& options, const GrowthControl& control,
                                         bool in_order) {
  const std::vector<int> keyframes = marked(keyframe);
  StageTiming start_time;
  Result<UncalibratedReconstruction> result = [&] {
    const ScopedTimer timer(start_time);
    return find_start(tracks, keyframes, options, control, in_order);
  }();
  if (!result) return result;
  result->stages["start"] = start_time;
  VideoGrowth growth(tracks, keyframe, options, &*result);
  if (auto grown = growth.grow(control); !grown) return grown.error();
  if (auto finished = finish(tracks, keyframe, options, control, &growth, &*result); !finished) {
    return finished.error();
  }
  return result;
}

// Whether a lens for each image poses far more images than one lens does, and those that it adds have surely
// another focal length, and fit as well as the start does: where the motion does not tell lenses, a lens for
// each image explains much that is wrong, but not well.
bool goes_much_further(const UncalibratedReconstruction& start,
                       const Result<UncalibratedReconstruction>& fixed,
                       const Result<UncalibratedReconstruction>& zoom) {
  constexpr double kFarMore = 1.1, kLeastChange = 0.05, kSigmas = 5, kWorse = 1.18;
  if (!fixed || !zoom || zoom->rms_px > kWorse * start.rms_px) return false;
  double sum = 0;
  int posed_by_fixed = 0;
  std::vector<double> changes, sigmas;
  for (size_t j = 0; j < zoom->image_posed.size(); ++j) {
    if (!fixed->image_posed[j]) continue;
    sum += std::log(fixed->scene.lenses[j].fx);
    ++posed_by_fixed;
  }
  for (size_t j = 0; j < zoom->image_posed.size(); ++j) {
    if (!zoom->image_posed[j] || fixed->image_posed[j]) continue;
    const double focal = zoom->scene.lenses[j].fx;
    changes.push_back(std::abs(std::log(focal) - sum / std::max(1, posed_by_fixed)));
    sigmas.push_back(zoom->lens_sigma[j][0] / focal);
  }
  if (static_cast<double>(changes.size()) <= (kFarMore - 1) * posed_by_fixed) return false;
  return median_of(&changes) > std::max(kLeastChange, kSigmas * median_of(&sigmas));
}

// The same video with one lens and with a lens for each image, side by side, and which of them it is.
Result<UncalibratedReconstruction> build_both(const PointTracks& tracks, std::span<const uint8_t> keyframe,
                                              const SolveOptions& options, const VideoOptions& video,
                                              ThreadPool* pool) {
  const int keyframes = static_cast<int>(marked(keyframe).size());
  std::mutex mutex;
  int posed[2] = {0, 0};
  Result<UncalibratedReconstruction> found[2] = {no_reconstruction(""), no_reconstruction("")};
  pool->parallel_for(2, [&](int i) {
    SolveOptions own = options;
    own.lens = i == 0 ? LensChange::kFixed : LensChange::kZoom;
    own.threads = std::max(1, options.threads / 2);
    const auto progress = [&, i](int count) {
      const std::lock_guard lock(mutex);
      posed[i] = count;
      if (video.progress) video.progress(std::min(posed[0], posed[1]), keyframes);
    };
    const GrowthControl control{progress, video.stop};
    found[i] = video.start ? extend(tracks, keyframe, own, control, *video.start)
                           : build(tracks, keyframe, own, control, video.in_order);
  });
  if (video.start && goes_much_further(*video.start, found[0], found[1])) {
    found[1]->lens_evidence = "far more images agree with a lens for each image than with one for all";
    return std::move(found[1]);
  }
  return choose_lens(tracks, keyframe, std::move(found[0]), std::move(found[1]), options.max_error_px,
                     video.in_order ? ErrorRelation::kAlongTracks : options.errors);
}

Result<UncalibratedReconstruction> build_one(const PointTracks& tracks, std::span<const uint8_t> keyframe,
                                             const SolveOptions& options, const VideoOptions& video) {
  const int keyframes = static_cast<int>(marked(keyframe).size());
  const auto progress = [&](int posed) {
    if (video.progress) video.progress(posed, keyframes);
  };
  const GrowthControl control{progress, video.stop};
  return video.start ? extend(tracks, keyframe, options, control, *video.start)
                     : build(tracks, keyframe, options, control, video.in_order);
}

// Standard deviations, and the images that are no key frames.
void complete(const PointTracks& tracks, std::span<const uint8_t> keyframe, const SolveOptions& options,
              ThreadPool* pool, UncalibratedReconstruction* result) {
  const PointTracks ideal = ideal_tracks(tracks, *result);
  if (!options.stopped() && !adjusts_one_lens(options, *result)) {
    VideoGrowth(ideal, keyframe, options, result).widen_sigma(pool);
  }
  share_lenses(tracks, options, result);
  add_model_error(result);
  result->degenerate =
      name_degeneracy(result->scene, result->image_posed, result->point_placed, result->lens_sigma);
  const ScopedTimer timer(result->stages["between"]);
  pose_between(ideal, keyframe, options, pool, result);
}

// Whether the focal length of the first posed image is, which stands for all where they share one, and most
// images agree with it.
bool is_surely_told(const UncalibratedReconstruction& r) {
  constexpr double kSure = 0.02;  // standard deviation, as a part of it: a third of what real footage has
  const int image = r.first_posed();
  if (image < 0 || r.lens_sigma.empty()) return false;
  return r.lens_sigma[image][0] < kSure * r.posed_share() * r.scene.lenses[image].fx;
}

}  // namespace

Result<UncalibratedReconstruction> reconstruct_video(const PointTracks& tracks,
                                                     std::span<const uint8_t> keyframe,
                                                     const SolveOptions& options, const VideoOptions& video) {
  if (auto ok = validate(tracks); !ok) return ok.error();
  if (static_cast<int>(keyframe.size()) != tracks.image_count) {
    return bad_input("keyframe: " + std::to_string(keyframe.size()) + " marks, must be " +
                     std::to_string(tracks.image_count));
  }
  MotionShares shares;
  if (video.in_order && !video.start) {
    shares = motion_shares(tracks, marked(keyframe), options.max_error_px, options.seed);
    const HopelessMotion hopeless = hopeless_motion(shares);
    if (!hopeless.name.empty()) return no_reconstruction(hopeless.name + ": " + hopeless.why);
  }
  ThreadPool pool(options.threads - 1);
  Result<UncalibratedReconstruction> result = options.lens == LensChange::kAuto
                                                  ? build_both(tracks, keyframe, options, video, &pool)
                                                  : build_one(tracks, keyframe, options, video);
  if (!result) return result;
  complete(tracks, keyframe, options, &pool, &*result);
  if (nearly_turns(shares) && result->degenerate.empty() && !is_surely_told(*result))
    result->degenerate = "pure rotation";
  return result;
}

ZoomSigns signs_of_zoom(const PointTracks& tracks, std::span<const uint8_t> keyframe,
                        const SolveOptions& options, ErrorRelation errors,
                        const UncalibratedReconstruction& fixed) {
  const PointTracks ideal = ideal_tracks(tracks, fixed);
  UncalibratedReconstruction one = fixed;
  one.radial = {};
  one.zooming = false;
  UncalibratedReconstruction many = one;
  many.zooming = true;
  for (UncalibratedReconstruction* r : {&one, &many}) {
    SolveOptions own = options;
    own.lens = r->zooming ? LensChange::kZoom : LensChange::kFixed;
    if (!VideoGrowth(ideal, keyframe, own, r).grow({})) return {};
  }
  Result<UncalibratedReconstruction> chosen =
      choose_lens(ideal, keyframe, std::move(one), std::move(many), options.max_error_px, errors);
  if (!chosen) return {};
  return {chosen->zooming, std::move(chosen->lens_evidence), chosen->lens_gain, chosen->lens_spread};
}

}  // namespace raysfm
