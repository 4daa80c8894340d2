#include "raysfm/api/track_zoom.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "raysfm/api/solve.h"
#include "raysfm/lenses/point_tracks.h"
#include "raysfm/scene/frame_lens.h"
#include "raysfm/scene/worlds.h"
#include "raysfm/uncalibrated/video_reconstruct.h"

namespace raysfm {
namespace {

constexpr double kMostKeyframes = 200;
constexpr double kEnough = 0.7;  // of the frames that one lens poses
// By how much a lens for each image must lower the rms, and the focal length change. Zooms by 1.1 and 1.2 of
// filmed footage lower the rms by less than 7 %, and then errors that are alike along tracks may bend the
// lenses more than one lens bends the path. A rolling shutter lowers it by a third, with focal lengths 2.3 %
// apart.
constexpr double kLeastGain = 1.1, kLeastSpread = 0.03;
constexpr double kBeyondShutters = 0.1;  // 33 ms of a walking camera: 0.05
// Of a stretch of a map whose shutter rolls: what its velocities leave lowered the rms by 12 % where a camera
// turned on the spot; of eleven films whose focal lengths change by as much zooms did by 36 % at least.
constexpr double kGainBeyondShutters = 1.2;
// Longest focal length over the shortest: no camera zooms farther in a film, and a hand that turned far on
// the spot before a rolling shutter was solved with 30 to 9188 pixels.
constexpr double kMostZoom = 30;
// Key frames of a map that are looked at together, from one such stretch to the next, and at least.
constexpr size_t kWindow = 40, kStep = 20, kLeastWindow = 10;
constexpr size_t kMostPoints = 600;  // the longest tracks of a stretch
constexpr int kLeastSeen = 3;        // key frames that see a point

// Key frames in a row, and what they see of the points that most of them see, as the lens without its
// distortion would show it.
struct MapStretch {
  PointTracks tracks;
  UncalibratedReconstruction found;
};

std::vector<int> points_seen_most(const Reconstruction& r, std::span<const KeyFrame> keyframes) {
  std::vector<int> seen(r.points.size(), 0), points;
  for (const KeyFrame& k : keyframes) {
    for (int o = k.first_observation; o < k.last_observation; ++o) ++seen[r.observations[o].point];
  }
  for (size_t i = 0; i < seen.size(); ++i) {
    if (seen[i] >= kLeastSeen) points.push_back(static_cast<int>(i));
  }
  std::ranges::stable_sort(points, std::greater(), [&](int i) { return seen[i]; });
  if (points.size() > kMostPoints) points.resize(kMostPoints);
  return points;
}

MapStretch stretch_of(const Reconstruction& r, const Lens& lens, std::span<const KeyFrame> keyframes) {
  const Camera& camera = r.rig.cameras[0];
  MapStretch s;
  s.tracks.image_size = {camera.width, camera.height};
  s.tracks.image_count = static_cast<int>(keyframes.size());
  std::vector<int> number(r.points.size(), -1);
  for (const int i : points_seen_most(r, keyframes)) {
    number[i] = s.tracks.point_count++;
    s.found.scene.points.push_back(r.points[i].position);
  }
  for (int j = 0; j < s.tracks.image_count; ++j) {
    const KeyFrame& k = keyframes[j];
    s.found.scene.cam_from_world.push_back(r.frames[k.frame].world_from_rig->inverse());
    for (int o = k.first_observation; o < k.last_observation; ++o) {
      const int point = number[r.observations[o].point];
      Ray ray;
      if (point < 0 || !camera.ray(r.observations[o].pixel, &ray) || !(ray.direction.z() > 0)) continue;
      const Eigen::Vector2d ideal = ray.direction.hnormalized();
      s.tracks.add(j, point, {lens.fx * ideal.x() + lens.cx, lens.fy * ideal.y() + lens.cy});
    }
  }
  s.found.scene.lenses.assign(keyframes.size(), lens);
  s.found.image_posed.assign(keyframes.size(), 1);
  s.found.point_placed.assign(s.tracks.point_count, 1);
  s.found.inlier.assign(s.tracks.size(), 1);
  return s;
}

struct FocalRange {
  double least = std::numeric_limits<double>::infinity(), most = 0;
};

FocalRange focal_range(const Reconstruction& r) {
  FocalRange range;
  for (const FrameLens& lens : r.lenses) {
    const double focal = lens_of(lens)->fx;
    range.least = std::min(range.least, focal), range.most = std::max(range.most, focal);
  }
  return range;
}

}  // namespace

bool can_be_solved(const TrackSettings& settings, double keyframes) {
  return keyframes <= kMostKeyframes && settings.inputs.size() == 1 && settings.map.empty() &&
         settings.save_map.empty();
}

std::optional<ZoomedStretch> zoom_in_map(const Reconstruction& r) {
  FrameLens of_all;
  of_all.camera = r.rig.cameras[0];
  const std::optional<Lens> lens = lens_of(of_all);
  if (!lens) return std::nullopt;
  const bool scans = of_all.camera.shutter.readout > 0;
  std::vector<std::vector<KeyFrame>> of_world(r.segments.size());
  for (const KeyFrame& k : r.keyframes) of_world[r.frames[k.frame].segment].push_back(k);
  for (const std::vector<KeyFrame>& keyframes : of_world) {
    for (size_t first = 0; first + kLeastWindow <= keyframes.size(); first += kStep) {
      const size_t count = std::min(kWindow, keyframes.size() - first);
      const MapStretch s = stretch_of(r, *lens, std::span(keyframes).subspan(first, count));
      const ZoomSigns signs = signs_of_zoom(s.tracks, std::vector<uint8_t>(s.tracks.image_count, 1), {},
                                            ErrorRelation::kAlongTracks, s.found);
      const bool may_be_shutter =
          scans && (signs.spread <= kBeyondShutters || signs.gain <= kGainBeyondShutters);
      if (signs.zooms && !may_be_shutter) {
        return ZoomedStretch{keyframes[first].frame, keyframes[first + count - 1].frame,
                             static_cast<double>(r.keyframes.size())};
      }
    }
  }
  return std::nullopt;
}

std::string zoom_warning(const std::optional<ZoomedStretch>& stretch) {
  if (!stretch) return {};
  return fmt::format(
      "frames {} to {} look as if the camera zoomed: poses are of one lens, raysfm solve finds a lens for "
      "each image",
      stretch->first_frame, stretch->last_frame);
}

bool is_beyond_shutters(const TrackResult& solved) {
  return solved.report.lens->gain == 0 || solved.report.lens->spread > kBeyondShutters;
}

bool reaches_enough(const TrackResult& solved, const Reconstruction& tracked) {
  const Reconstruction& r = solved.reconstruction;
  return posed_count(r) >= kEnough * posed_count(tracked) &&
         placed_count(r) >= kEnough * placed_count(tracked);
}

std::optional<TrackResult> solved_zoom(const TrackSettings& settings, const TrackCallbacks& callbacks) {
  SolveSettings of_solve;
  of_solve.input = settings.inputs[0];
  of_solve.images = "video";
  of_solve.fps = settings.fps;
  of_solve.range = settings.range;
  of_solve.threads = settings.threads;
  of_solve.seed = settings.odometry.seed;
  SolveCallbacks solving;
  solving.event = callbacks.event;
  solving.stop = callbacks.stop;
  Result<SolveResult> solved = solve(of_solve, solving);
  if (!solved) return {};
  const LensReport& lens = *solved->report.lens;
  const bool is_clear = lens.gain == 0 || (lens.gain > kLeastGain && lens.spread > kLeastSpread);
  const bool is_sure = lens.zooming && lens.degenerate.empty() && is_clear;
  if (!is_sure) return {};
  const FocalRange focals = focal_range(solved->reconstruction);
  if (focals.most > kMostZoom * focals.least) return {};
  TrackResult result{std::move(solved->reconstruction), std::move(solved->report)};
  result.report.input = settings.inputs;
  result.report.warnings.push_back(fmt::format(
      "the camera zooms, its focal length is {:.0f} to {:.0f} px: this is the result of raysfm solve, with a "
      "lens for each image",
      focals.least, focals.most));
  return result;
}

}  // namespace raysfm
