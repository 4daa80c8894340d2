#include "raysfm/odometry/localiser.h"

#include <fmt/format.h>

#include <algorithm>

namespace raysfm {
namespace {

constexpr float kMinZncc = 0.75f;
constexpr int kMaxLocalPoints = 800;
constexpr double kCornerError = 4.0;   // pixels: inliers before the alignment
constexpr double kAlignedError = 2.0;  // pixels: inliers after it
constexpr int kMinInliers = 20;
constexpr double kMaxScaleChange = 1.4, kMinViewCosine = 0.94;  // of a reference patch, against the anchor

// How many of a sample of key frame k's points the anchor's camera would see.
int overlap(const Map& map, std::span<const KeyFrameView> views, const Camera& camera, int k, int anchor) {
  constexpr int kStep = 8;
  const Rigid3 cam_from_world = camera.rig_from_cam.inverse() * map.keyframes[anchor].rig_from_world;
  const MapKeyFrame& keyframe = map.keyframes[k];
  int seen = 0;
  if (!views[k].view) return 0;
  for (int f = 0; f < keyframe.size(); f += kStep) {
    const int track = keyframe.tracks[f];
    if (track < 0 || !map.tracks[track].triangulated) continue;
    Eigen::Vector2d pixel;
    seen += camera.project(cam_from_world * map.tracks[track].position, &pixel) && camera.contains(pixel);
  }
  return seen;
}

// The patch that a track is looked for with: the earliest one that the anchor would see at about the same
// scale and from about the same side. Patches taken over from key frame to key frame would drift; this one
// does not.
LocalPoint reference_patch(const Map& map, std::span<const KeyFrameView> views, const Camera& camera,
                           int track, int anchor, LocalPoint latest) {
  const Eigen::Vector3d position = map.tracks[track].position;
  const auto from_camera = [&](int k) -> Eigen::Vector3d {
    return position - (map.keyframes[k].rig_from_world.inverse() * camera.rig_from_cam).translation;
  };
  const Eigen::Vector3d seen = from_camera(anchor);
  for (const TrackObservation& o : map.tracks[track].observations) {
    if (o.keyframe >= latest.keyframe) break;
    if (!views[o.keyframe].view || !map.keyframes[o.keyframe].inliers[o.feature]) continue;
    const Eigen::Vector3d then = from_camera(o.keyframe);
    const double scale = then.norm() / seen.norm();
    const double cosine = then.dot(seen) / (then.norm() * seen.norm());
    if (scale > 1 / kMaxScaleChange && scale < kMaxScaleChange && cosine > kMinViewCosine) {
      latest.keyframe = o.keyframe;
      latest.feature = o.feature;
      break;
    }
  }
  return latest;
}

}  // namespace

LocalMap make_local_map(const Map& map, std::span<const KeyFrameView> views, const Camera& camera, int anchor,
                        int reach) {
  LocalMap local;
  local.anchor = anchor;
  std::vector<std::pair<int, int>> others;  // (overlap, key frame)
  for (int k = 0; k < static_cast<int>(map.keyframes.size()); ++k) {
    const int seen = k == anchor ? 0 : overlap(map, views, camera, k, anchor);
    if (seen > 0) others.push_back({seen, k});
  }
  std::sort(others.begin(), others.end(), std::greater<>());
  others.resize(std::min<size_t>(others.size(), reach));
  others.insert(others.begin(), {0, anchor});

  std::vector<uint8_t> taken(map.tracks.size(), 0);
  for (const auto& [seen, k] : others) {
    if (static_cast<int>(local.points.size()) >= kMaxLocalPoints) break;
    const MapKeyFrame& keyframe = map.keyframes[k];
    for (int f = 0; f < keyframe.size(); ++f) {
      const int track = keyframe.tracks[f];
      if (track < 0 || !keyframe.inliers[f] || !map.tracks[track].triangulated || taken[track]) continue;
      taken[track] = 1;
      local.points.push_back(reference_patch(map, views, camera, track, anchor, {track, k, f, k == anchor}));
    }
  }
  std::stable_sort(local.points.begin(), local.points.end(),
                   [](const LocalPoint& a, const LocalPoint& b) { return a.keyframe < b.keyframe; });
  return local;
}

void Localiser::predict(const Map& map, std::span<const KeyFrameView> views, const LocalMap& local,
                        const Rigid3& rig_from_world, float radius, int max_points) {
  const Camera& camera = rig_.cameras[0];
  const Rigid3 cam_from_rig = camera.rig_from_cam.inverse();
  queries_.clear();
  int keyframe = -1;
  Rigid3 cam_from_keyframe;
  Eigen::Vector3d center = Eigen::Vector3d::Zero();  // of the key frame, world
  const int step = std::max(1, static_cast<int>(local.points.size()) / max_points);
  for (size_t i = 0; i < local.points.size(); i += step) {
    const LocalPoint& p = local.points[i];
    if (p.keyframe != keyframe) {
      keyframe = p.keyframe;
      const Rigid3 world_from_keyframe =
          map.keyframes[keyframe].rig_from_world.inverse() * camera.rig_from_cam;
      cam_from_keyframe = cam_from_rig * rig_from_world * world_from_keyframe;
      center = world_from_keyframe.translation;
    }
    PatchQuery query{.keyframe = p.keyframe,
                     .feature = p.feature,
                     .track = p.track,
                     .in_anchor = p.in_anchor,
                     .radius = radius};
    const Eigen::Vector3d& position = map.tracks[p.track].position;
    if (!predict_patch(camera, views[keyframe], p.feature, (position - center).norm(), cam_from_keyframe,
                       &query)) {
      continue;
    }
    Eigen::Vector2d pixel;
    if (!camera.project(cam_from_rig * (rig_from_world * position), &pixel)) continue;
    query.predicted = pixel.cast<float>();
    queries_.push_back(query);
  }
}

// Pose from points_ and pixels_.
bool Localiser::estimate(const Rigid3* prior, int frame, double max_error_px) {
  ScopedTimer timer(pose_timing);
  estimator_.estimate(rig_, {points_, pixels_, {}}, prior,
                      {.max_error_px = max_error_px,
                       .min_inliers = kMinInliers,
                       .seed = options_.seed,
                       .stream = static_cast<uint64_t>(frame)},
                      &estimate_);
  return estimate_.ok();
}

bool Localiser::pose_from_matches(const Map& map, std::span<const TrackPixel> matches, int frame,
                                  Rigid3* rig_from_world) {
  points_.clear();
  pixels_.clear();
  for (const TrackPixel& m : matches) {
    points_.push_back(map.tracks[m.track].position);
    pixels_.push_back(m.pixel.cast<double>());
  }
  if (!estimate(nullptr, frame, kCornerError)) return false;
  *rig_from_world = estimate_.rig_from_world;
  return true;
}

// Sub-pixel places of all visible points about a first pose, and the pose that they give.
bool Localiser::align(const Map& map, std::span<const KeyFrameView> views, const LocalMap& local,
                      const View& view) {
  {
    ScopedTimer timer(align_timing);
    predict(map, views, local, estimate_.rig_from_world, 0, kMaxLocalPoints);
    starts_.clear();
    for (const PatchQuery& q : queries_) starts_.push_back(q.predicted);
    matcher_.align(views, queries_, starts_, view, {.min_zncc = kMinZncc}, &alignments_);
    aligned_.clear();
    points_.clear();
    pixels_.clear();
    for (size_t i = 0; i < queries_.size(); ++i) {
      if (!alignments_[i].converged) continue;
      aligned_.push_back({queries_[i].track, queries_[i].in_anchor, alignments_[i].pixel});
      points_.push_back(map.tracks[queries_[i].track].position);
      pixels_.push_back(alignments_[i].pixel.cast<double>());
    }
  }
  return refine_estimate();
}

// estimate_ again, from points_ and pixels_.
bool Localiser::refine_estimate() {
  ScopedTimer timer(pose_timing);
  estimate_.inlier.assign(points_.size(), 1);
  estimator_.refine(rig_, {points_, pixels_, {}}, {.max_error_px = kAlignedError, .min_inliers = kMinInliers},
                    &estimate_);
  return estimate_.ok();
}

Localisation Localiser::localise(const Map& map, std::span<const KeyFrameView> views, const LocalMap& local,
                                 const View& view, const Rigid3& predicted_rig_from_world,
                                 const SearchRange& range) {
  {
    ScopedTimer timer(match_timing);
    predict(map, views, local, predicted_rig_from_world, range.radius_px, range.coarse_points);
    matcher_.match(views, queries_, view, kMinZncc, &corners_);
    points_.clear();
    pixels_.clear();
    for (const GuidedMatch& m : corners_) {
      points_.push_back(map.tracks[queries_[m.query].track].position);
      pixels_.push_back(m.pixel.cast<double>());
    }
  }
  Localisation out;
  if (!estimate(&predicted_rig_from_world, view.frame, kCornerError)) {
    out.reason = fmt::format("{} of {} visible points matched, {} agree on a pose", corners_.size(),
                             queries_.size(), estimate_.inlier_count);
    return out;
  }
  const bool aligned = align(map, views, local, view);
  out.visible = static_cast<int>(queries_.size());
  for (const PatchQuery& q : queries_) out.visible_in_anchor += q.in_anchor;
  if (!aligned) {
    out.reason = fmt::format("{} of {} visible points aligned, {} agree on a pose", points_.size(),
                             out.visible, estimate_.inlier_count);
    return out;
  }
  out.ok = true;
  out.rig_from_world = estimate_.rig_from_world;
  out.covariance = estimate_.covariance;
  out.sigma_px = estimate_.sigma_px;
  for (size_t i = 0; i < aligned_.size(); ++i) {
    if (!estimate_.inlier[i]) continue;
    out.matches.push_back(aligned_[i]);
    out.matched_with_anchor += aligned_[i].in_anchor;
  }
  return out;
}

bool Localiser::refine(const Map& map, std::span<const TrackPixel> matches, Rigid3* rig_from_world,
                       Matrix6d* covariance) {
  points_.clear();
  pixels_.clear();
  for (const TrackPixel& m : matches) {
    if (!map.tracks[m.track].triangulated) continue;
    points_.push_back(map.tracks[m.track].position);
    pixels_.push_back(m.pixel.cast<double>());
  }
  estimate_.rig_from_world = *rig_from_world;
  if (!refine_estimate()) return false;
  *rig_from_world = estimate_.rig_from_world;
  *covariance = estimate_.covariance;
  return true;
}

}  // namespace raysfm
