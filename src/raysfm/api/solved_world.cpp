#include "raysfm/api/solved_world.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "raysfm/robust/absolute_pose.h"

namespace raysfm {
namespace {

Rigid3 found_from_world(const SolvedWorld& world) {
  const auto first = std::ranges::find(world.image_posed, 1);
  if (world.is_given || first == world.image_posed.end()) return {};
  return world.cam_from_world[first - world.image_posed.begin()].inverse();
}

void pose_frames(const SolvedWorld& world, int segment, std::vector<PosedFrame>* frames) {
  const Rigid3 from_world = found_from_world(world);
  for (size_t j = 0; j < frames->size(); ++j) {
    if (!world.image_posed[j]) continue;
    PosedFrame& frame = (*frames)[j];
    const Rigid3 cam_from_world = world.cam_from_world[j] * from_world;
    frame.segment = segment;
    frame.world_from_rig = cam_from_world.inverse();
    // The upper triangle is what the file holds.
    frame.covariance =
        covariance_in_world(cam_from_world, world.covariances[j]).selfadjointView<Eigen::Upper>();
  }
}

// The points that have a place; returns the number of each among those of `r`, -1 for the others.
std::vector<int> add_points(const SolveInput& input, const SolvedWorld& world, int segment,
                            Reconstruction* r) {
  const Rigid3 world_from_found = found_from_world(world).inverse();
  std::vector<int> number(world.point_placed.size(), -1);
  for (size_t i = 0; i < number.size(); ++i) {
    if (!world.point_placed[i]) continue;
    number[i] = static_cast<int>(r->points.size());
    MapPoint& point = r->points.emplace_back();
    point.position = world_from_found * world.points[i];
    point.segment = segment;
    if (!input.rgb.empty()) point.rgb = input.rgb[i];
  }
  return number;
}

// The observations that agree, of key frames with a pose.
void add_keyframes(const SolveInput& input, const SolvedWorld& world, const std::vector<int>& number,
                   Reconstruction* r) {
  std::vector<std::vector<Observation>> of_image(input.names.size());
  for (int k = 0; k < input.tracks.size(); ++k) {
    const int image = input.tracks.image[k];
    if (!world.inlier[k]) continue;
    of_image[image].push_back({number[input.tracks.point[k]], 0, input.tracks.pixel[k] - input.shift(image)});
  }
  for (int j = 0; j < static_cast<int>(of_image.size()); ++j) {
    if (!input.keyframe[j] || !world.image_posed[j]) continue;
    const auto first = static_cast<int>(r->observations.size());
    r->observations.insert(r->observations.end(), of_image[j].begin(), of_image[j].end());
    r->keyframes.push_back({j, first, static_cast<int>(r->observations.size())});
  }
}

double rms_of_both(double a, size_t of_a, double b, size_t of_b) {
  if (of_a == 0) return b;
  const auto m = static_cast<double>(of_a), n = static_cast<double>(of_b);
  return std::sqrt((m * a * a + n * b * b) / (m + n));
}

// What an image's inliers say of its pose, points held; zero where that is nothing.
Matrix6d covariance_of(const RayReconstruction& found, const PointTracks& tracks,
                       const std::vector<int>& inliers, int image, PoseEstimator* estimator) {
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector2d> pixels;
  for (const int k : inliers) {
    points.push_back(found.points[tracks.point[k]]);
    pixels.push_back(tracks.pixel[k]);
  }
  PoseEstimate estimate;
  estimate.rig_from_world = found.cam_from_world[image];
  estimate.inlier.assign(points.size(), 1);
  estimator->refine(Rig{{found.camera}}, {.points_in_world = points, .pixels = pixels}, {}, &estimate);
  return estimate.ok() ? estimate.covariance : Matrix6d::Zero();
}

double rms_of(const PointTracks& tracks, const RayReconstruction& found) {
  double squares = 0;
  int count = 0;
  for (int k = 0; k < tracks.size(); ++k) {
    Eigen::Vector2d residual;
    if (!found.inlier[k] || !pixel_residual(tracks, found, k, &residual)) continue;
    squares += residual.squaredNorm();
    ++count;
  }
  return std::sqrt(squares / std::max(1, count));
}

}  // namespace

std::vector<PosedFrame> frames_of(const SolveInput& input) {
  std::vector<PosedFrame> frames(input.names.size());
  for (size_t j = 0; j < frames.size(); ++j) {
    frames[j].timestamp = input.timestamps[j];
    frames[j].image_name = input.names[j];
  }
  return frames;
}

void add_world(const SolveInput& input, const SolvedWorld& world, Reconstruction* r) {
  const auto first = std::ranges::find(world.image_posed, 1);
  if (first == world.image_posed.end()) return;
  const auto last = std::find(world.image_posed.rbegin(), world.image_posed.rend(), 1).base() - 1;
  const auto segment = static_cast<int>(r->segments.size());
  pose_frames(world, segment, &r->frames);
  const size_t before = r->observations.size();
  add_keyframes(input, world, add_points(input, world, segment, r), r);
  r->rms_reprojection_px =
      rms_of_both(r->rms_reprojection_px, before, world.rms_px, r->observations.size() - before);
  Segment& added = r->segments.emplace_back();
  added.first = static_cast<int>(first - world.image_posed.begin());
  added.last = static_cast<int>(last - world.image_posed.begin());
  added.metric_scale = world.is_given;
  r->starts.push_back(world.start);
}

void add_world(const SolveInput& input, const RayReconstruction& found, Reconstruction* r) {
  std::vector<std::vector<int>> inliers(input.names.size());
  for (int k = 0; k < input.tracks.size(); ++k) {
    if (found.inlier[k]) inliers[input.tracks.image[k]].push_back(k);
  }
  PoseEstimator estimator;
  std::vector<Matrix6d> covariances(input.names.size(), Matrix6d::Zero());
  for (size_t j = 0; j < covariances.size(); ++j) {
    if (!found.image_posed[j]) continue;
    covariances[j] = covariance_of(found, input.tracks, inliers[j], static_cast<int>(j), &estimator);
  }
  const std::vector<int> start(found.start_images.begin(), found.start_images.end());
  add_world(input,
            {.cam_from_world = found.cam_from_world,
             .covariances = covariances,
             .points = found.points,
             .image_posed = found.image_posed,
             .point_placed = found.point_placed,
             .inlier = found.inlier,
             .rms_px = rms_of(input.tracks, found),
             .start = {"three views", start, found.start_inliers}},
            r);
}

void give_reasons(const SolveInput& input, bool interrupted, Reconstruction* r) {
  for (Segment& segment : r->segments) {
    const size_t next = segment.last + 1;
    const bool goes_on = input.in_order && next < r->frames.size() && !r->frames[next].world_from_rig;
    segment.reason = goes_on ? r->frames[next].reason : interrupted ? "interrupted" : "end of input";
  }
}

}  // namespace raysfm
