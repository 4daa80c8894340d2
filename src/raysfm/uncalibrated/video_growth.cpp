#include "raysfm/uncalibrated/video_growth.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "raysfm/geometry/triangulation.h"

namespace raysfm {
namespace {

constexpr int kMinPlacedInImage = 20;
constexpr int kKeyframesBetweenAdjustments = 4;
constexpr double kMinParallax = 0.02;             // radians, of a point that is placed
constexpr double kKeyframePrincipalPoint = 0.01;  // standard deviations, as shares of the image's larger side
constexpr double kBetweenPrincipalPoint = 0.003;

Lens between(const Lens& a, const Lens& b, double share) {
  return Lens::from_vector((1 - share) * a.vector() + share * b.vector());
}

// Straight way of the centre, constant turn.
Rigid3 between(const Rigid3& a, const Rigid3& b, double share) {
  const Rigid3 world_from_a = a.inverse(), world_from_b = b.inverse();
  Rigid3 world_from_cam;
  world_from_cam.rotation = world_from_a.rotation.slerp(share, world_from_b.rotation);
  world_from_cam.translation = (1 - share) * world_from_a.translation + share * world_from_b.translation;
  return world_from_cam.inverse();
}

}  // namespace

VideoGrowth::VideoGrowth(const PointTracks& tracks, std::span<const uint8_t> keyframe,
                         const SolveOptions& options, UncalibratedReconstruction* result)
    : tracks_(tracks),
      keyframe_(keyframe),
      options_(options),
      result_(*result),
      of_image_(tracks.image_count),
      of_point_(tracks.point_count) {
  for (int k = 0; k < tracks.size(); ++k) {
    of_image_[tracks.image[k]].push_back(k);
    if (keyframe[tracks.image[k]]) of_point_[tracks.point[k]].push_back(k);
  }
}

// The nearest posed key frame in the direction of `step`, -1 without one.
int VideoGrowth::nearest_posed(int image, int step) const {
  for (int j = image + step; j >= 0 && j < tracks_.image_count; j += step) {
    if (keyframe_[j] && result_.image_posed[j]) return j;
  }
  return -1;
}

// The key frame beside a posed one that sees most placed points, -1 without one.
int VideoGrowth::next_keyframe(const std::vector<uint8_t>& tried) const {
  int best = -1, most = kMinPlacedInImage - 1;
  for (int j = 0; j < tracks_.image_count; ++j) {
    if (!keyframe_[j] || result_.image_posed[j] || tried[j]) continue;
    const auto placed = static_cast<int>(
        std::ranges::count_if(of_image_[j], [&](int k) { return result_.point_placed[tracks_.point[k]]; }));
    if (placed > most) best = j, most = placed;
  }
  return best;
}

bool VideoGrowth::pose(int image, const Rigid3& near_pose, const Lens& near_lens,
                       double principal_point_sigma_px) {
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector2d> pixels;
  std::vector<int> observations;
  for (const int k : of_image_[image]) {
    if (!result_.point_placed[tracks_.point[k]]) continue;
    points.push_back(result_.scene.points[tracks_.point[k]]);
    pixels.push_back(tracks_.pixel[k]);
    observations.push_back(k);
  }
  const LensResectionOptions options{.max_error_px = options_.max_error_px,
                                     .zooming = result_.zooming,
                                     .principal_point_sigma_px = principal_point_sigma_px,
                                     .seed = options_.seed,
                                     .stream = static_cast<uint64_t>(image)};
  LensResection view;
  if (!resect_with_lens(points, pixels, near_pose, near_lens, options, &view)) return false;
  result_.image_posed[image] = 1;
  result_.scene.cam_from_world[image] = view.cam_from_world;
  result_.scene.lenses[image] = view.lens;
  if (result_.zooming) result_.lens_sigma[image] = view.lens_sigma;
  for (size_t i = 0; i < observations.size(); ++i) result_.inlier[observations[i]] = view.inlier[i];
  return true;
}

bool VideoGrowth::place(int point) {
  std::vector<Ray> rays;
  for (const int k : of_point_[point]) {
    const int image = tracks_.image[k];
    if (!result_.image_posed[image]) continue;
    const Lens& lens = result_.scene.lenses[image];
    const Rigid3 world_from_cam = result_.scene.cam_from_world[image].inverse();
    const double y = (tracks_.pixel[k].y() - lens.cy) / lens.fy;
    const double x = (tracks_.pixel[k].x() - lens.cx - lens.skew * y) / lens.fx;
    rays.push_back(
        {world_from_cam.translation, (world_from_cam.rotation * Eigen::Vector3d(x, y, 1)).normalized()});
  }
  Triangulation found;
  if (rays.size() < 2 || !triangulate(rays, &found) || found.parallax < kMinParallax) return false;
  for (const int k : of_point_[point]) {
    const int image = tracks_.image[k];
    if (!result_.image_posed[image]) continue;
    const Eigen::Vector3d x = result_.scene.cam_from_world[image] * found.point;
    if (!(x.z() > 0)) return false;
    const Eigen::Vector2d pixel = result_.scene.lenses[image].pixel(x.hnormalized());
    if (!((pixel - tracks_.pixel[k]).norm() < options_.max_error_px)) return false;
  }
  result_.scene.points[point] = found.point;
  return true;
}

void VideoGrowth::place_points() {
  for (int i = 0; i < tracks_.point_count; ++i) {
    if (!result_.point_placed[i]) result_.point_placed[i] = place(i);
  }
  find_inliers();
}

// Judges the observations in key frames; a point without two inliers or with more outliers is given up.
void VideoGrowth::find_inliers() {
  for (int i = 0; i < tracks_.point_count; ++i) {
    int good = 0, seen = 0;
    for (const int k : of_point_[i]) {
      const int image = tracks_.image[k];
      result_.inlier[k] = 0;
      if (!result_.image_posed[image]) continue;
      ++seen;
      const Eigen::Vector3d x = result_.scene.cam_from_world[image] * result_.scene.points[i];
      if (!result_.point_placed[i] || !(x.z() > 0)) continue;
      const Eigen::Vector2d pixel = result_.scene.lenses[image].pixel(x.hnormalized());
      result_.inlier[k] = (pixel - tracks_.pixel[k]).norm() < options_.max_error_px;
      good += result_.inlier[k];
    }
    if (good >= 2 && 2 * good > seen) continue;
    result_.point_placed[i] = 0;
    for (const int k : of_point_[i]) result_.inlier[k] = 0;
  }
}

Result<void> VideoGrowth::adjust(bool last) {
  LensAdjustmentOptions adjustment;
  LensConstraints& constraints = adjustment.constraints;
  constraints.equal = !result_.zooming;
  constraints.principal_point = tracks_.centre();
  constraints.principal_point_sigma =
      options_.principal_point_sigma * tracks_.image_size.maxCoeff() / (options_.max_error_px / 3);
  adjustment.method = options_.constraints;
  adjustment.loss = {RobustLoss::Kind::kHuber, options_.max_error_px / 3};
  adjustment.reweightings = last ? 3 : 1;
  adjustment.with_sigma = last;
  if (!last) adjustment.lm = {.max_iterations = 10, .min_relative_decrease = 1e-3};
  std::vector<double> weights(tracks_.size(), 0.0);
  for (int k = 0; k < tracks_.size(); ++k) weights[k] = keyframe_[tracks_.image[k]] && result_.inlier[k];
  const bool free = last && options_.method == LensMethod::kIntrinsicsFree;
  auto summary = free ? adjust_intrinsics_free(tracks_, weights, adjustment, &result_.scene)
                      : adjust_standard(tracks_, weights, adjustment, &result_.scene);
  if (!summary) return summary.error();
  if (last) {
    result_.lens_sigma = summary->lens_sigma;
    result_.adjustment = std::move(*summary);
  }
  find_inliers();
  return {};
}

// Images that are not key frames: near a place between their neighbours.
void VideoGrowth::pose_between() {
  const double side = tracks_.image_size.maxCoeff();
  for (int j = 0; j < tracks_.image_count; ++j) {
    if (keyframe_[j]) continue;
    const int a = nearest_posed(j, -1), b = nearest_posed(j, 1);
    if (a < 0 && b < 0) continue;
    const int from = a < 0 ? b : a, to = b < 0 ? a : b;
    const double share = from == to ? 0 : double(j - from) / (to - from);
    const UncalibratedScene& scene = result_.scene;
    const Rigid3 near_pose = between(scene.cam_from_world[from], scene.cam_from_world[to], share);
    const Lens near_lens = between(scene.lenses[from], scene.lenses[to], share);
    if (pose(j, near_pose, near_lens, kBetweenPrincipalPoint * side) && !result_.zooming) {
      result_.lens_sigma[j] = result_.lens_sigma[from];
    }
  }
}

void VideoGrowth::measure() {
  double sum = 0;
  int count = 0;
  for (int k = 0; k < tracks_.size(); ++k) {
    const int image = tracks_.image[k];
    if (!keyframe_[image] || !result_.inlier[k]) continue;
    const Eigen::Vector3d x = result_.scene.cam_from_world[image] * result_.scene.points[tracks_.point[k]];
    sum += (result_.scene.lenses[image].pixel(x.hnormalized()) - tracks_.pixel[k]).squaredNorm();
    ++count;
  }
  result_.rms_px = count > 0 ? std::sqrt(sum / count) : 0;
}

Result<void> VideoGrowth::run() {
  result_.lens_sigma.assign(tracks_.image_count,
                            LensVector::Constant(std::numeric_limits<double>::infinity()));
  place_points();
  std::vector<uint8_t> tried(tracks_.image_count, 0);
  int added = 0;
  for (int image; (image = next_keyframe(tried)) >= 0;) {
    tried[image] = 1;
    const int a = nearest_posed(image, -1), b = nearest_posed(image, 1);
    const int near = a < 0 || (b >= 0 && b - image < image - a) ? b : a;
    const double sigma = kKeyframePrincipalPoint * tracks_.image_size.maxCoeff();
    if (!pose(image, result_.scene.cam_from_world[near], result_.scene.lenses[near], sigma)) continue;
    place_points();
    if (++added % kKeyframesBetweenAdjustments != 0) continue;
    if (auto r = adjust(false); !r) return r;
    place_points();
    std::ranges::fill(tried, 0);  // better points may show those that failed
  }
  for (const bool last : {false, true}) {
    if (auto r = adjust(last); !r) return r;
    if (!last) place_points();
  }
  pose_between();
  measure();
  return {};
}

}  // namespace raysfm
