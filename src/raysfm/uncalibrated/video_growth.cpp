#include "raysfm/uncalibrated/video_growth.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "raysfm/geometry/interpolation.h"
#include "raysfm/geometry/triangulation.h"
#include "raysfm/uncalibrated/lens_choice.h"

namespace raysfm {
namespace {

constexpr int kMinPlacedInImage = 20;
// An adjustment follows when this part of the key frames, and at least so many, are new.
constexpr double kNewShare = 0.15;
constexpr int kMinNew = 4;
constexpr int kGroups = 10;                       // of the jackknife
constexpr double kMorePoints = 1.3;               // than at the last failure: an image is tried again
constexpr double kMinStepParallax = 0.02;         // radians, of a point that is placed
constexpr double kKeyframePrincipalPoint = 0.01;  // standard deviations, as shares of the image's larger side
constexpr double kBetweenPrincipalPoint = 0.003;
// Focal lengths that are tried, as multiples of that of the nearest key frame: between the two lenses may
// have zoomed unseen.
constexpr std::array kZoomFactors = {1.0, 0.9, 1.11, 0.8, 1.25, 0.7, 1.42, 0.62, 1.6};

Lens between(const Lens& a, const Lens& b, double share) {
  return Lens::from_vector((1 - share) * a.vector() + share * b.vector());
}

// The nearest posed key frame in the direction of `step`, -1 without one.
int nearest_posed(std::span<const uint8_t> keyframe, const UncalibratedReconstruction& result, int image,
                  int step) {
  for (int j = image + step; j >= 0 && j < static_cast<int>(keyframe.size()); j += step) {
    if (keyframe[j] && result.image_posed[j]) return j;
  }
  return -1;
}

// Poses an image by the placed points among its observations.
bool pose_image(const PointTracks& tracks, std::span<const int> observations_in_image,
                const Rigid3& near_pose, const Lens& near_lens, double principal_point_sigma_px,
                const SolveOptions& options, int image, UncalibratedReconstruction* result) {
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector2d> pixels;
  std::vector<int> observations;
  for (const int k : observations_in_image) {
    if (!result->point_placed[tracks.point[k]]) continue;
    points.push_back(result->scene.points[tracks.point[k]]);
    pixels.push_back(tracks.pixel[k]);
    observations.push_back(k);
  }
  const LensResectionOptions resection{.max_error_px = options.max_error_px,
                                       .zooming = result->zooming,
                                       .principal_point_sigma_px = principal_point_sigma_px,
                                       .seed = options.seed,
                                       .stream = static_cast<uint64_t>(image)};
  LensResection view;
  if (!resect_with_lens(points, pixels, near_pose, near_lens, resection, &view)) return false;
  result->image_posed[image] = 1;
  result->scene.cam_from_world[image] = view.cam_from_world;
  result->scene.lenses[image] = view.lens;
  if (result->zooming) result->lens_sigma[image] = view.lens_sigma;
  for (size_t i = 0; i < observations.size(); ++i) result->inlier[observations[i]] = view.inlier[i];
  return true;
}

}  // namespace

VideoGrowth::VideoGrowth(const PointTracks& tracks, std::span<const uint8_t> keyframe,
                         const SolveOptions& options, UncalibratedReconstruction* result)
    : tracks_(tracks),
      keyframe_(keyframe),
      options_(options),
      result_(*result),
      of_image_(tracks.image_count),
      of_point_(tracks.point_count),
      seen_when_tried_(tracks.image_count, 0) {
  in_keyframes_.image_count = tracks.image_count;
  in_keyframes_.point_count = tracks.point_count;
  in_keyframes_.image_size = tracks.image_size;
  for (int k = 0; k < tracks.size(); ++k) {
    if (!keyframe[tracks.image[k]]) continue;
    of_image_[tracks.image[k]].push_back(k);
    of_point_[tracks.point[k]].push_back(k);
    in_keyframes_.add(tracks.image[k], tracks.point[k], tracks.pixel[k]);
    original_.push_back(k);
  }
}

int VideoGrowth::placed_points_in(int image) const {
  return static_cast<int>(
      std::ranges::count_if(of_image_[image], [&](int k) { return result_.point_placed[tracks_.point[k]]; }));
}

// The key frame that sees most placed points, -1 without one worth a try.
int VideoGrowth::next_keyframe() const {
  int best = -1, most = kMinPlacedInImage - 1;
  for (int j = 0; j < tracks_.image_count; ++j) {
    if (!keyframe_[j] || result_.image_posed[j]) continue;
    const int placed = placed_points_in(j);
    if (placed > most && placed > kMorePoints * seen_when_tried_[j]) best = j, most = placed;
  }
  return best;
}

bool VideoGrowth::pose(int image) {
  const ScopedTimer timer(result_.stages["pose"]);
  const int a = nearest_posed(keyframe_, result_, image, -1), b = nearest_posed(keyframe_, result_, image, 1);
  const int near = a < 0 || (b >= 0 && b - image < image - a) ? b : a;
  if (near < 0) return false;
  const Rigid3 near_pose = result_.scene.cam_from_world[near];
  const double centre_sigma = kKeyframePrincipalPoint * tracks_.image_size.maxCoeff();
  for (const double factor : kZoomFactors) {
    if (factor != 1 && !result_.zooming) break;
    Lens lens = result_.scene.lenses[near];
    lens.fx *= factor, lens.fy *= factor;
    if (pose_image(tracks_, of_image_[image], near_pose, lens, centre_sigma, options_, image, &result_)) {
      return true;
    }
  }
  return false;
}

bool VideoGrowth::place(int point) {
  std::vector<Ray> rays;
  for (const int k : of_point_[point]) {
    const int image = tracks_.image[k];
    if (!result_.image_posed[image]) continue;
    const Lens& lens = result_.scene.lenses[image];
    const Rigid3 world_from_cam = result_.scene.cam_from_world[image].inverse();
    const Eigen::Vector3d direction = lens.normalised(tracks_.pixel[k]).homogeneous();
    rays.push_back({world_from_cam.translation, (world_from_cam.rotation * direction).normalized()});
  }
  Triangulation found;
  if (rays.size() < 2 || !triangulate(rays, &found) || found.parallax < kMinStepParallax) return false;
  for (const int k : of_point_[point]) {
    const int image = tracks_.image[k];
    if (!result_.image_posed[image]) continue;
    const Eigen::Vector2d r = pixel_residual(result_.scene.cam_from_world[image], result_.scene.lenses[image],
                                             {}, found.point, tracks_.pixel[k]);
    if (!(r.norm() < options_.max_error_px)) return false;
  }
  result_.scene.points[point] = found.point;
  return true;
}

void VideoGrowth::place_points() {
  for (int i = 0; i < tracks_.point_count; ++i) {
    if (!result_.point_placed[i]) result_.point_placed[i] = place(i);
    judge(i);
  }
}

void VideoGrowth::place_points_in(int image) {
  for (const int k : of_image_[image]) {
    const int i = tracks_.point[k];
    if (!result_.point_placed[i]) result_.point_placed[i] = place(i);
    judge(i);
  }
}

// Judges the observations in key frames; a point without two inliers or with more outliers is given up.
void VideoGrowth::judge(int point) {
  int good = 0, seen = 0;
  for (const int k : of_point_[point]) {
    result_.inlier[k] = 0;
    if (!result_.image_posed[tracks_.image[k]]) continue;
    ++seen;
    if (!result_.point_placed[point]) continue;
    result_.inlier[k] = pixel_residual(tracks_, result_.scene, {}, k).norm() < options_.max_error_px;
    good += result_.inlier[k];
  }
  if (good >= 2 && 2 * good > seen) return;
  result_.point_placed[point] = 0;
  for (const int k : of_point_[point]) result_.inlier[k] = 0;
}

LensAdjustmentOptions VideoGrowth::adjustment_options() const {
  LensAdjustmentOptions adjustment;
  adjustment.constraints = constraints_for(tracks_, options_, !result_.zooming);
  adjustment.method = options_.constraints;
  adjustment.loss = {RobustLoss::Kind::kHuber, options_.max_error_px / 3};
  adjustment.with_sigma = false;
  adjustment.threads = options_.threads;
  adjustment.lm.progress = &options_.go_on;
  return adjustment;
}

Result<void> VideoGrowth::adjust(bool last) {
  const ScopedTimer timer(result_.stages["adjust"]);
  LensAdjustmentOptions adjustment = adjustment_options();
  adjustment.reweightings = last ? 3 : 1;
  adjustment.with_sigma = last;
  if (!last) {
    adjustment.lm.max_iterations = 10;
    adjustment.lm.min_relative_decrease = 1e-3;
    adjustment.lm.initial_damping = LmOptions{}.initial_damping;
  }
  std::vector<double> weights;
  for (const int k : original_) weights.push_back(result_.inlier[k]);
  const bool free = last && options_.method == LensMethod::kIntrinsicsFree;
  auto summary = free ? adjust_intrinsics_free(in_keyframes_, weights, adjustment, &result_.scene)
                      : adjust_standard(in_keyframes_, weights, adjustment, &result_.scene);
  if (!summary) return summary.error();
  if (last) {
    result_.lens_sigma = summary->lens_sigma;
    result_.adjustment = std::move(*summary);
  }
  for (int i = 0; i < tracks_.point_count; ++i) judge(i);
  return {};
}

// Of the loss, as the residuals are now.
std::vector<double> VideoGrowth::robust_weights() const {
  const RobustLoss loss = adjustment_options().loss;
  std::vector<double> weights;
  for (const int k : original_) {
    const double square = pixel_residual(tracks_, result_.scene, {}, k).squaredNorm();
    weights.push_back(result_.inlier[k] ? loss.weight(square) : 0);
  }
  return weights;
}

std::optional<RadialEstimate> VideoGrowth::radial() const {
  const ScopedTimer timer(result_.stages["distortion"]);
  return estimate_radial(in_keyframes_, robust_weights(), adjustment_options(), result_.scene);
}

// By point: tracks that begin in one key frame live through the same images, and their errors are alike.
std::vector<int> VideoGrowth::groups_by_birth() const {
  std::vector<int> group(tracks_.point_count, 0), number(tracks_.image_count, 0);
  for (int j = 1; j < tracks_.image_count; ++j) number[j] = number[j - 1] + keyframe_[j - 1];
  for (int i = 0; i < tracks_.point_count; ++i) {
    if (!of_point_[i].empty()) group[i] = number[tracks_.image[of_point_[i].front()]] % kGroups;
  }
  return group;
}

void VideoGrowth::widen_sigma(ThreadPool* pool) {
  const ScopedTimer timer(result_.stages["jackknife"]);
  const std::vector<double> all = robust_weights();
  const std::vector<int> group_of = groups_by_birth();
  std::vector<std::vector<Lens>> lenses(kGroups);
  pool->parallel_for(kGroups, [&](int group) {
    LensAdjustmentOptions adjustment = adjustment_options();
    adjustment.loss.kind = RobustLoss::Kind::kNone;  // the weights have it in them
    adjustment.threads = 1;
    adjustment.lm.initial_damping = 1e-6;  // near the bottom
    std::vector<double> weights = all;
    for (size_t k = 0; k < weights.size(); ++k) {
      if (group_of[in_keyframes_.point[k]] == group) weights[k] = 0;
    }
    UncalibratedScene scene = result_.scene;
    if (adjust_standard(in_keyframes_, weights, adjustment, &scene)) lenses[group] = std::move(scene.lenses);
  });
  std::erase_if(lenses, [](const auto& group) { return group.empty(); });
  if (lenses.size() < 2) return;
  const double count = static_cast<double>(lenses.size());
  for (int j = 0; j < tracks_.image_count; ++j) {
    if (!keyframe_[j] || !result_.image_posed[j]) continue;
    LensVector mean = LensVector::Zero(), square = LensVector::Zero();
    for (const auto& group : lenses) mean += group[j].vector() / count;
    for (const auto& group : lenses) square += (group[j].vector() - mean).cwiseAbs2();
    const LensVector spread = ((count - 1) / count * square).cwiseSqrt();
    LensVector& sigma = result_.lens_sigma[j];
    sigma = sigma.cwiseMax(spread);
  }
}

Result<void> VideoGrowth::grow(const GrowthControl& control) {
  result_.lens_sigma.assign(tracks_.image_count,
                            LensVector::Constant(std::numeric_limits<double>::infinity()));
  place_points();
  int posed = result_.posed_count(), added = 0;
  for (int image; !control.stopped() && (image = next_keyframe()) >= 0;) {
    if (!pose(image)) {
      seen_when_tried_[image] = placed_points_in(image);
      continue;
    }
    ++posed, ++added;
    if (control.progress) control.progress(posed);
    place_points_in(image);
    if (added < std::max<double>(kMinNew, kNewShare * posed)) continue;
    added = 0;
    if (auto r = adjust(false); !r) return r;
    place_points();
  }
  if (auto r = adjust(false); !r) return r;
  place_points();
  return {};
}

Result<void> VideoGrowth::finish() {
  place_points();
  if (auto r = adjust(true); !r) return r;
  result_.rms_px = rms_error(tracks_, result_.scene, {}, result_.inlier);
  return {};
}

void pose_between(const PointTracks& tracks, std::span<const uint8_t> keyframe, const SolveOptions& options,
                  ThreadPool* pool, UncalibratedReconstruction* result) {
  const double sigma = kBetweenPrincipalPoint * tracks.image_size.maxCoeff();
  std::vector<std::vector<int>> of_image(tracks.image_count);
  for (int k = 0; k < tracks.size(); ++k) {
    if (!keyframe[tracks.image[k]]) of_image[tracks.image[k]].push_back(k);
  }
  pool->parallel_for(tracks.image_count, [&](int j) {
    if (keyframe[j] || options.stopped()) return;
    const int a = nearest_posed(keyframe, *result, j, -1), b = nearest_posed(keyframe, *result, j, 1);
    if (a < 0 && b < 0) return;
    const int from = a < 0 ? b : a, to = b < 0 ? a : b;
    const double share = from == to ? 0 : double(j - from) / (to - from);
    const UncalibratedScene& scene = result->scene;
    const Rigid3 near_pose = interpolate(scene.cam_from_world[from], scene.cam_from_world[to], share);
    const Lens near_lens = between(scene.lenses[from], scene.lenses[to], share);
    const bool posed = pose_image(tracks, of_image[j], near_pose, near_lens, sigma, options, j, result);
    if (!posed) return;
    // The map is no better known than the lenses of the key frames.
    LensVector of_map = result->lens_sigma[from].cwiseAbs2();
    if (from != to) of_map = (1 - share) * of_map + share * result->lens_sigma[to].cwiseAbs2();
    LensVector& sigma = result->lens_sigma[j];
    sigma = ((result->zooming ? sigma.cwiseAbs2() : LensVector(LensVector::Zero())) + of_map).cwiseSqrt();
  });
}

}  // namespace raysfm
