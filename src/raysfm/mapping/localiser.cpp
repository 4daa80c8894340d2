#include "raysfm/mapping/localiser.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <utility>

namespace raysfm {
namespace {

constexpr float kMinPoseZncc = 0.75f;
constexpr int kMaxLocalPoints = 800;  // for one camera
// Standard deviations, which are pixels of the octave: inliers before the alignment, and after it.
constexpr double kCornerError = 4.0, kAlignedError = 2.0;
constexpr int kMinInliers = 20;
// First poses without corners: points aligned for one, and how many octaves above the one in which they look
// most alike. From a pose that is only as exact as pixels of that octave, kitchens come out 8 % worse: the
// same points are aligned once more.
constexpr int kFirstPoints = 150, kCoarser = 2;
// Octaves above that in which a patch looks most alike, in a blurred view, and points for a first pose of it.
constexpr int kMostCoarser = 2, kFirstPointsBlurred = 400;
constexpr PatchAlignmentOptions kFirstAlignment{
    .max_iterations = 10, .stop_px = 0.1f, .max_shift_px = 5, .min_zncc = kMinPoseZncc};
constexpr PatchAlignmentOptions kAlignment{.min_zncc = kMinPoseZncc};
constexpr double kMaxScaleChange = 1.4, kMinViewCosine = 0.94;  // of a reference patch, against the anchor

// For a first pose, with each effort: radius as a part of the image's longer side, and points matched.
constexpr std::array<std::pair<float, int>, 3> kSearch = {{{0.015f, 300}, {0.04f, 600}, {0.12f, 1000}}};
// To believe a pose: points, and parts of the visible points of the anchor.
constexpr int kMinMatches = 20;
constexpr double kMinMatchedShare = 0.3, kGoodMatchedShare = 0.45;
constexpr double kManyMatchedShare = 0.2;  // after a loss, where many points agree

bool found_share(const Localisation& pose, double share) {
  return pose.ok && static_cast<int>(pose.matches.size()) >= kMinMatches &&
         pose.matched_with_anchor >= share * pose.visible_in_anchor;
}

int max_local_points(const TrackingRig& rig) {
  return kMaxLocalPoints * (rig.size() + 1) / 2;
}

// How many of a sample of key frame k's points the rig's cameras would see.
int overlap(const Map& map, const TrackingRig& rig, int k, const Rigid3& rig_from_world) {
  constexpr int kStep = 8;
  const MapKeyFrame& keyframe = map.keyframes[k];
  std::vector<std::pair<Eigen::Matrix3d, Eigen::Vector3d>> cams_from_world;
  for (int c = 0; c < rig.size(); ++c) {
    const Rigid3 cam_from_world = rig.cam_from_rig(c) * rig_from_world;
    cams_from_world.emplace_back(cam_from_world.rotation.toRotationMatrix(), cam_from_world.translation);
  }
  int seen = 0;
  for (int f = 0; f < keyframe.size(); f += kStep) {
    const int track = keyframe.tracks[f];
    if (track < 0 || !map.tracks[track].triangulated) continue;
    const Eigen::Vector3d& point = map.tracks[track].position;
    Eigen::Vector2d pixel;
    bool visible = false;
    for (int c = 0; c < rig.size() && !visible; ++c) {
      const auto& [rotation, translation] = cams_from_world[c];
      visible = rig.see(c, rotation * point + translation, &pixel);
    }
    seen += visible;
  }
  return seen;
}

// Chooses the patch that a track is looked for with: the earliest one that the anchor would see at about the
// same scale and from about the same side. Patches taken over from key frame to key frame would drift; this
// one does not.
class ReferencePatches {
 public:
  ReferencePatches(const Map& map, std::span<const KeyFrameView> views, const TrackingRig& rig, int anchor)
      : map_(map), views_(views), cameras_(rig.size()), anchor_(anchor) {
    centers_.resize(views.size() * cameras_);
    for (int k = 0; k < static_cast<int>(views.size()); ++k) {
      if (!views[k].view && k != anchor) continue;
      const Rigid3 world_from_rig = map.keyframes[k].rig_from_world.inverse();
      for (int c = 0; c < cameras_; ++c)
        centers_[static_cast<size_t>(k) * cameras_ + c] =
            (world_from_rig * rig.camera(c).rig_from_cam).translation;
    }
  }

  LocalPoint choose(LocalPoint latest) const {
    const Track& track = map_.tracks[latest.track];
    const int camera = map_.keyframes[latest.keyframe].cameras[latest.feature];
    const Eigen::Vector3d seen = track.position - center(anchor_, camera);
    const double seen2 = seen.squaredNorm();
    for (const TrackObservation& o : track.observations) {
      if (o.keyframe >= latest.keyframe) break;
      const MapKeyFrame& k = map_.keyframes[o.keyframe];
      if (!views_[o.keyframe].view || !k.inliers[o.feature]) continue;
      const Eigen::Vector3d then = track.position - center(o.keyframe, k.cameras[o.feature]);
      const double then2 = then.squaredNorm(), dot = then.dot(seen);
      constexpr double kMaxChange2 = kMaxScaleChange * kMaxScaleChange;
      const bool like_scale = then2 * kMaxChange2 > seen2 && then2 < kMaxChange2 * seen2;
      if (like_scale && dot > 0 && dot * dot > kMinViewCosine * kMinViewCosine * then2 * seen2)
        return {latest.track, o.keyframe, o.feature, latest.in_anchor};
    }
    return latest;
  }

 private:
  const Eigen::Vector3d& center(int keyframe, int camera) const {
    return centers_[static_cast<size_t>(keyframe) * cameras_ + camera];
  }

  const Map& map_;
  std::span<const KeyFrameView> views_;
  int cameras_, anchor_;
  std::vector<Eigen::Vector3d> centers_;  // of the cameras in the world, where there are images
};

}  // namespace

LocalMap make_local_map(const Map& map, std::span<const KeyFrameView> views, const TrackingRig& rig,
                        int anchor, int reach) {
  LocalMap local;
  local.anchor = anchor;
  std::vector<std::pair<int, int>> others;  // (overlap, key frame)
  for (int k = static_cast<int>(map.keyframes.size()) - 1; k >= 0; --k) {
    if (!views[k].view && k != anchor) break;  // forgotten, and those before it
    const int seen = k == anchor ? 0 : overlap(map, rig, k, map.keyframes[anchor].rig_from_world);
    if (seen > 0) others.push_back({seen, k});
  }
  std::sort(others.begin(), others.end(), std::greater<>());
  others.resize(std::min<size_t>(others.size(), reach));
  others.insert(others.begin(), {0, anchor});

  const ReferencePatches patches(map, views, rig, anchor);
  std::vector<uint8_t> taken(map.tracks.size(), 0);
  for (const auto& [seen, k] : others) {
    if (static_cast<int>(local.points.size()) >= max_local_points(rig)) break;
    const MapKeyFrame& keyframe = map.keyframes[k];
    for (int f = 0; f < keyframe.size(); ++f) {
      const int track = keyframe.tracks[f];
      if (track < 0 || !keyframe.inliers[f] || !map.tracks[track].triangulated) continue;
      if (std::exchange(taken[track], 1)) continue;
      local.points.push_back(patches.choose({track, k, f, k == anchor}));
    }
  }
  const auto source = [&](const LocalPoint& p) {
    return std::pair(p.keyframe, map.keyframes[p.keyframe].cameras[p.feature]);
  };
  std::stable_sort(local.points.begin(), local.points.end(),
                   [&](const LocalPoint& a, const LocalPoint& b) { return source(a) < source(b); });
  return local;
}

int keyframe_in_sight(const Map& map, std::span<const KeyFrameView> views, const TrackingRig& rig,
                      const Rigid3& rig_from_world) {
  int best = -1, most = 0;
  for (int k = static_cast<int>(map.keyframes.size()) - 1; k >= 0 && views[k].view; --k) {
    const int seen = overlap(map, rig, k, rig_from_world);
    if (seen > most) best = k, most = seen;
  }
  return best;
}

// Queries for every camera that should see a point, whichever saw it before.
void Localiser::predict(const Map& map, std::span<const KeyFrameView> views, const LocalMap& local,
                        const View& view, const Rigid3& rig_from_world, float radius, int max_points) {
  queries_.clear();
  step_ = std::max(1, static_cast<int>(local.points.size()) / max_points);
  for (int c = 0; c < rig_.size(); ++c) predict_in(c, map, views, local, view, rig_from_world, radius);
}

void Localiser::predict_in(int camera, const Map& map, std::span<const KeyFrameView> views,
                           const LocalMap& local, const View& view, const Rigid3& rig_from_world,
                           float radius) {
  const Rigid3 cam_from_world = rig_.cam_from_rig(camera) * rig_from_world;
  const Eigen::Matrix3d cam_from_world_rotation = cam_from_world.rotation.toRotationMatrix();
  const Eigen::Matrix3d rig_from_world_rotation = rig_from_world.rotation.toRotationMatrix();
  int keyframe = -1, source = -1;
  Eigen::Matrix3d source_rotation = Eigen::Matrix3d::Identity();  // world_from_source, with the next
  Eigen::Vector3d source_in_world = Eigen::Vector3d::Zero();
  Eigen::Matrix3d cam_from_source_rotation = Eigen::Matrix3d::Identity();
  for (size_t i = 0; i < local.points.size(); i += step_) {
    const LocalPoint& p = local.points[i];
    if (p.keyframe != keyframe || views[keyframe].cameras[p.feature] != source) {
      keyframe = p.keyframe;
      source = views[keyframe].cameras[p.feature];
      const Rigid3 world_from_source =
          (rig_.cam_from_rig(source) * map.keyframes[keyframe].rig_from_world).inverse();
      cam_from_source_rotation = (cam_from_world * world_from_source).rotation.toRotationMatrix();
      source_rotation = world_from_source.rotation.toRotationMatrix();
      source_in_world = world_from_source.translation;
    }
    const Eigen::Vector3d& position = map.tracks[p.track].position;
    const Eigen::Vector3d origin = views[keyframe].origins[p.feature].cast<double>();
    const double distance = (position - source_in_world - source_rotation * origin).norm();
    PatchQuery query{.keyframe = p.keyframe,
                     .feature = p.feature,
                     .camera = camera,
                     .track = p.track,
                     .point = static_cast<int>(i),
                     .radius = radius};
    const Eigen::Vector3d in_cam = cam_from_world_rotation * position + cam_from_world.translation;
    PointProjection seen;
    seen.in_image = rig_.see(camera, in_cam, &seen.pixel, &seen.jacobian);
    if (!predict_patch(rig_, views[keyframe], p.feature, distance, camera, cam_from_source_rotation, in_cam,
                       seen, view.cameras[camera], &query)) {
      continue;
    }
    if (rig_.scans()) {
      query.predicted +=
          predict_scan_offset(rig_, camera, rig_from_world_rotation * position + rig_from_world.translation,
                              motion_, query.predicted.cast<double>());
    }
    queries_.push_back(query);
  }
}

// By how much a rolling shutter moved each of what was seen.
void Localiser::work_out_offsets(const Map& map, const Rigid3& about) {
  for (int c = 0; c < rig_.size(); ++c) {
    of_camera_.clear(), in_rig_.clear(), pixels_.clear();
    for (size_t i = 0; i < seen_.size(); ++i) {
      if (seen_[i].camera != c) continue;
      of_camera_.push_back(static_cast<int>(i));
      in_rig_.push_back(about * map.tracks[seen_[i].track].position);
      pixels_.push_back(seen_[i].pixel.cast<double>());
    }
    camera_offsets_.resize(of_camera_.size());
    scan_offsets(rig_, c, in_rig_, motion_, pixels_, camera_offsets_);
    for (size_t k = 0; k < of_camera_.size(); ++k) offsets_[of_camera_[k]] = camera_offsets_[k];
  }
}

// Observations of what was seen, but where the pixel has no ray to measure an angle from. `about`: a first
// pose of the rig.
void Localiser::make_observations(const Map& map, const Rigid3& about) {
  offsets_.assign(seen_.size(), Eigen::Vector2f::Zero());
  if (rig_.scans()) work_out_offsets(map, about);
  points_.clear(), pixels_.clear(), cameras_.clear(), rays_.clear(), sigmas_.clear();
  kept_.clear();
  for (size_t i = 0; i < seen_.size(); ++i) {
    const TrackPixel& seen = seen_[i];
    const Eigen::Vector2f pixel = seen.pixel - offsets_[i];
    if (rig_.angular()) {
      ObservedRay ray;
      if (!rig_.observe(seen.camera, pixel, &ray)) continue;
      rays_.push_back(ray);
    }
    kept_.push_back(static_cast<int>(i));
    points_.push_back(map.tracks[seen.track].position);
    pixels_.push_back(pixel.cast<double>());
    cameras_.push_back(seen.camera);
    sigmas_.push_back(octave_side(seen.octave));
  }
}

// Pose from the observations.
bool Localiser::estimate(const Rigid3* prior, uint64_t stream, double max_error_px) {
  ScopedTimer timer(pose_timing);
  estimator_.estimate(
      rig_.rig(), observations(), prior,
      {.max_error_px = max_error_px, .min_inliers = kMinInliers, .seed = options_.seed, .stream = stream},
      &estimate_);
  return estimate_.ok();
}

Localisation Localiser::pose_from_matches(const Map& map, std::span<const TrackPixel> matches,
                                          uint64_t stream, const Rigid3& about) {
  Localisation out;
  seen_.assign(matches.begin(), matches.end());
  make_observations(map, about);
  aligned_.clear();
  for (const int i : kept_) aligned_.push_back({matches[i], false});
  out.ok = estimate(nullptr, stream, kCornerError);
  if (!out.ok) {
    out.reason = fmt::format("{} of {} corners agree on a pose", estimate_.inlier_count, points_.size());
    return out;
  }
  out.rig_from_world = estimate_.rig_from_world;
  out.covariance = estimate_.covariance;
  out.sigma_px = estimate_.sigma_px;
  for (size_t i = 0; i < aligned_.size(); ++i) {
    if (estimate_.inlier[i]) out.matches.push_back(aligned_[i]);
  }
  return out;
}

// Observations of some points from a predicted pose, some octaves above those in which they look most alike.
void Localiser::align_some(int coarser, int most, const Map& map, std::span<const KeyFrameView> views,
                           const LocalMap& local, const View& view, const Rigid3& rig_from_world) {
  predict(map, views, local, view, rig_from_world, 0, most);
  starts_.clear();
  for (PatchQuery& q : queries_) {
    coarsen(*view.cameras[q.camera].octaves, coarser, &q);
    starts_.push_back(q.predicted);
  }
  matcher_.align(views, queries_, starts_, view, kFirstAlignment, &alignments_, FinerOctaves::kLeft);
  seen_.clear();
  for (size_t i = 0; i < queries_.size(); ++i) {
    if (alignments_[i].converged) seen_.push_back(seen_at(queries_[i], alignments_[i]));
  }
  make_observations(map, rig_from_world);
}

void Localiser::clear_open() {
  open_.clear();
  open_queries_.clear();
  starts_.clear();
}

// A query is to be aligned, some octaves above its own.
void Localiser::open(size_t query, const View& view, int coarser) {
  open_.push_back(static_cast<int>(query));
  PatchQuery opened = queries_[query];
  coarsen(*view.cameras[opened.camera].octaves, coarser, &opened);
  starts_.push_back(opened.predicted);
  open_queries_.push_back(opened);
}

void Localiser::align_open(std::span<const KeyFrameView> views, const View& view, FinerOctaves finer) {
  matcher_.align(views, open_queries_, starts_, view, kAlignment, &open_alignments_, finer);
  for (size_t k = 0; k < open_.size(); ++k) alignments_[open_[k]] = open_alignments_[k];
}

// Sub-pixel places of the queries that were not found before.
void Localiser::align_queries(std::span<const KeyFrameView> views, const View& view,
                              std::span<const PointMatch> found) {
  const auto key = [](const TrackPixel& m) { return std::pair(m.track, m.camera); };
  known_.assign(found.begin(), found.end());
  std::ranges::sort(known_, {}, key);
  alignments_.resize(queries_.size());
  clear_open();
  for (size_t i = 0; i < queries_.size(); ++i) {
    const std::pair wanted(queries_[i].track, static_cast<uint8_t>(queries_[i].camera));
    const auto at = std::ranges::lower_bound(known_, wanted, {}, key);
    if (at != known_.end() && key(*at) == wanted) {
      alignments_[i] = {{at->pixel, 1, true}, at->octave};
    } else {
      open(i, view, 0);
    }
  }
  align_open(views, view, FinerOctaves::kTried);
}

// Of the queries those that were not found, in coarser and coarser octaves.
void Localiser::align_blurred(std::span<const KeyFrameView> views, const View& view) {
  for (int coarser = 1; coarser <= kMostCoarser; ++coarser) {
    clear_open();
    for (size_t i = 0; i < queries_.size(); ++i) {
      if (!alignments_[i].converged) open(i, view, coarser);
    }
    align_open(views, view, FinerOctaves::kLeft);
  }
}

// Sub-pixel places of all visible points about a first pose, and the pose that they give.
bool Localiser::align(const Map& map, std::span<const KeyFrameView> views, const LocalMap& local,
                      const View& view, std::span<const PointMatch> found, Focus focus) {
  {
    ScopedTimer timer(align_timing);
    predict(map, views, local, view, estimate_.rig_from_world, 0, max_local_points(rig_));
    align_queries(views, view, found);
    if (focus == Focus::kBlurred) align_blurred(views, view);
    seen_.clear();
    found_queries_.clear();
    for (size_t i = 0; i < queries_.size(); ++i) {
      if (!alignments_[i].converged) continue;
      seen_.push_back(seen_at(queries_[i], alignments_[i]));
      found_queries_.push_back(static_cast<int>(i));
    }
    make_observations(map, estimate_.rig_from_world);
    aligned_.clear();
    aligned_point_.clear();
    aligned_coarser_.clear();
    for (const int i : kept_) {
      const PatchQuery& q = queries_[found_queries_[i]];
      aligned_.push_back({seen_[i], local.points[q.point].in_anchor});
      aligned_point_.push_back(q.point);
      aligned_coarser_.push_back(seen_[i].octave > q.octave);
    }
  }
  return refine_estimate();
}

// estimate_ again, from the observations.
bool Localiser::refine_estimate() {
  ScopedTimer timer(pose_timing);
  estimate_.inlier.assign(points_.size(), 1);
  estimator_.refine(rig_.rig(), observations(), {.max_error_px = kAlignedError, .min_inliers = kMinInliers},
                    &estimate_);
  return estimate_.ok();
}

// What of the local map should be seen, and what was found of it.
void Localiser::count(const LocalMap& local, bool aligned, Localisation* out) {
  constexpr uint8_t kVisible = 1, kMatched = 2;
  counted_.assign(local.points.size(), 0);
  for (size_t i = 0; i < local.points.size(); i += step_) out->anchor_points += local.points[i].in_anchor;
  for (const PatchQuery& q : queries_) {
    if (counted_[q.point] != 0) continue;
    counted_[q.point] = kVisible;
    ++out->visible;
    out->visible_in_anchor += local.points[q.point].in_anchor;
  }
  for (size_t i = 0; aligned && i < aligned_.size(); ++i) {
    if (!estimate_.inlier[i]) continue;
    out->matches.push_back(aligned_[i]);
    out->blurred += aligned_coarser_[i];
    uint8_t& counted = counted_[aligned_point_[i]];
    out->matched_with_anchor += aligned_[i].in_anchor && counted != kMatched;
    counted = kMatched;
  }
}

Localisation Localiser::localise(const Map& map, std::span<const KeyFrameView> views, const LocalMap& local,
                                 const View& view, const Rigid3& predicted_rig_from_world,
                                 const SearchRange& range) {
  {
    ScopedTimer timer(match_timing);
    predict(map, views, local, view, predicted_rig_from_world, range.radius_px, range.coarse_points);
    matcher_.match(views, queries_, view, kMinPoseZncc, &corners_);
    seen_.clear();
    for (const GuidedMatch& m : corners_) seen_.push_back(seen_at(queries_[m.query], m));
    make_observations(map, predicted_rig_from_world);
  }
  Localisation out;
  if (!estimate(&predicted_rig_from_world, view.random_stream(), kCornerError)) {
    out.reason = fmt::format("{} of {} visible points matched, {} agree on a pose", corners_.size(),
                             queries_.size(), estimate_.inlier_count);
    return out;
  }
  return align_all(map, views, local, view);
}

Localisation Localiser::follow(const Map& map, std::span<const KeyFrameView> views, const LocalMap& local,
                               const View& view, const Rigid3& predicted, Focus focus) {
  const bool blurred = focus == Focus::kBlurred;
  const int finest = blurred ? kMostCoarser : 0;
  Rigid3 rig_from_world = predicted;
  for (int coarser = finest + kCoarser; coarser >= finest; coarser -= blurred ? 1 : kCoarser) {
    {
      ScopedTimer timer(match_timing);
      align_some(coarser, blurred ? kFirstPointsBlurred : kFirstPoints, map, views, local, view,
                 rig_from_world);
    }
    const bool posed = estimate(&rig_from_world, view.random_stream(), kAlignedError);
    // A blur that is wide in this octave gives a few poses by chance.
    if (posed && (!blurred || 2 * estimate_.inlier_count >= static_cast<int>(points_.size()))) {
      rig_from_world = estimate_.rig_from_world;
    } else if (!blurred || coarser == finest) {
      return {};
    }
  }
  return align_all(map, views, local, view, {}, focus);
}

Localisation Localiser::follow_again(const Map& map, std::span<const KeyFrameView> views,
                                     const LocalMap& local, const View& view, const Rigid3& predicted,
                                     std::span<const PointMatch> found) {
  seen_.clear();
  for (const PointMatch& m : found) {
    if (map.tracks[m.track].triangulated) seen_.push_back(m);
  }
  make_observations(map, predicted);
  estimate_.rig_from_world = predicted;
  if (!refine_estimate()) return {};
  return align_all(map, views, local, view, found);
}

Localisation Localiser::align_all(const Map& map, std::span<const KeyFrameView> views, const LocalMap& local,
                                  const View& view, std::span<const PointMatch> found, Focus focus) {
  Localisation out;
  out.ok = align(map, views, local, view, found, focus);
  count(local, out.ok, &out);
  if (!out.ok) {
    out.reason = fmt::format("{} of {} visible points aligned, {} agree on a pose", points_.size(),
                             out.visible, estimate_.inlier_count);
    return out;
  }
  out.rig_from_world = estimate_.rig_from_world;
  out.covariance = estimate_.covariance;
  out.sigma_px = estimate_.sigma_px;
  return out;
}

bool Localiser::refine(const Map& map, std::span<const TrackPixel> matches, Rigid3* rig_from_world,
                       Matrix6d* covariance) {
  seen_.clear();
  for (const TrackPixel& m : matches) {
    if (map.tracks[m.track].triangulated) seen_.push_back(m);
  }
  make_observations(map, *rig_from_world);
  estimate_.rig_from_world = *rig_from_world;
  if (!refine_estimate()) return false;
  *rig_from_world = estimate_.rig_from_world;
  *covariance = estimate_.covariance;
  return true;
}

SearchRange range_of(Effort effort, const View& view) {
  const auto& [radius_share, coarse_points] = kSearch[static_cast<size_t>(effort)];
  return {radius_share * static_cast<float>(view.cameras[0].longer_side()), coarse_points};
}

bool believable(const Localisation& pose) {
  return found_share(pose, kMinMatchedShare);
}

bool convincing(const Localisation& pose) {
  return found_share(pose, kGoodMatchedShare);
}

bool recognised(const Localisation& pose, const OdometryOptions& options) {
  return convincing(pose) ||
         (found_share(pose, kManyMatchedShare) && 4 * pose.matched_with_anchor >= options.min_matches);
}

bool followed(const Localisation& pose, const OdometryOptions& options) {
  return believable(pose) || recognised(pose, options);
}

bool anchor_is_in_sight(const Localisation& pose) {
  constexpr double kLeastInSight = 0.3;  // of the anchor's points
  return pose.ok && pose.visible_in_anchor >= kLeastInSight * pose.anchor_points;
}

Localisation seen_by_keyframe(const MapKeyFrame& keyframe, const Map& map) {
  Localisation pose;
  pose.ok = true;
  pose.rig_from_world = keyframe.rig_from_world;
  for (int f = 0; f < keyframe.size(); ++f) {
    const int track = keyframe.tracks[f];
    if (track < 0 || !keyframe.inliers[f] || !map.tracks[track].triangulated) continue;
    pose.matches.push_back({{track, keyframe.cameras[f], keyframe.octaves[f], keyframe.pixels[f]}, true});
  }
  return pose;
}

}  // namespace raysfm
