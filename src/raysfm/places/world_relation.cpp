#include "raysfm/places/world_relation.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "raysfm/core/median.h"

namespace raysfm {
namespace {

constexpr size_t kMinPoints = 12;
// Median deviation of the logarithms of the ratios of two distances of a point, beyond which they are no
// ratios of one scale; and of one scale from another that ought to be the same.
constexpr double kMaxSpread = 0.2, kMaxScaleError = 0.15;
constexpr double kSigmaOfMedian = 1.4826 * 1.2533;  // of normal errors, from the median deviation
constexpr double kThereError = 8;                   // standard deviations of a corner

// Whether the key frame of the place sees, where it saw the track there, the position that the point has
// here.
bool is_seen_there(const TrackingRig& rig, const Map& there, int keyframe, int track,
                   const Eigen::Vector3d& point_there, bool* agrees) {
  const MapKeyFrame& k = there.keyframes[keyframe];
  for (const TrackObservation& o : there.tracks[track].observations) {
    if (o.keyframe != keyframe) continue;
    const int camera = k.cameras[o.feature];
    *agrees = is_seen_about(rig, camera, k.octaves[o.feature], k.instant_pixel(o.feature),
                            k.rig_from_world * point_there);
    return true;
  }
  return false;
}

}  // namespace

DescribedCorners described_corners(const MapKeyFrame& keyframe) {
  DescribedCorners out;
  for (size_t i = 0; i < keyframe.described.size(); ++i) {
    const int f = keyframe.described[i];
    if (keyframe.tracks[f] < 0) continue;
    out.corners.push_back({keyframe.tracks[f], keyframe.cameras[f], keyframe.octaves[f], keyframe.pixels[f]});
    out.descriptors.push_back(keyframe.descriptors[i]);
  }
  return out;
}

std::optional<ScaleOfWorlds> scale_of(std::vector<double> log_ratios, bool same_scale) {
  if (log_ratios.size() < kMinPoints) return std::nullopt;
  const double log_scale = median_of(&log_ratios);
  for (double& r : log_ratios) r = std::abs(r - log_scale);
  const double spread = median_of(&log_ratios);
  if (!(spread < kMaxSpread) || (same_scale && std::abs(log_scale) > kMaxScaleError)) return std::nullopt;
  if (same_scale) return ScaleOfWorlds{};
  return ScaleOfWorlds{std::exp(log_scale),
                       kSigmaOfMedian * spread / std::sqrt(static_cast<double>(log_ratios.size()))};
}

WorldRelation relation_by(const Rigid3& rig_from_here, const Rigid3& rig_from_there,
                          const ScaleOfWorlds& scale) {
  const Similarity3 rig_there_from_here{scale.scale, rig_from_here.rotation,
                                        scale.scale * rig_from_here.translation};
  return {similarity_of(rig_from_there.inverse()) * rig_there_from_here, scale.log_sigma, {}};
}

bool is_seen_about(const TrackingRig& rig, int camera, int octave, const Eigen::Vector2f& pixel,
                   const Eigen::Vector3d& in_rig) {
  Eigen::Vector2d seen;
  return rig.find(camera, rig.cam_from_rig(camera) * in_rig, &seen) &&
         (seen - pixel.cast<double>()).norm() < kThereError * octave_side(octave);
}

std::optional<WorldRelation> relate_worlds(const TrackingRig& rig, const Map& here, int keyframe,
                                           const DescribedCorners& seen, const Map& there,
                                           const RecognisedPlace& place, bool same_scale) {
  const Rigid3& rig_from_here = here.keyframes[keyframe].rig_from_world;
  std::vector<SamePoint> points;
  std::vector<double> ratios;
  for (const CornerOfTrack& m : place.matches) {
    const int track = seen.corners[m.corner].track;
    if (track < 0 || !here.tracks[track].triangulated) continue;
    const double here_distance = (rig_from_here * here.tracks[track].position).norm();
    const double there_distance = (place.rig_from_world * there.tracks[m.track].position).norm();
    ratios.push_back(std::log(there_distance / here_distance));
    points.push_back({track, m.track});
  }
  const auto scale = scale_of(std::move(ratios), same_scale);
  if (!scale) return std::nullopt;
  WorldRelation out = relation_by(rig_from_here, place.rig_from_world, *scale);
  out.points = std::move(points);

  int looked_at = 0, agreeing = 0;
  for (const SamePoint& p : out.points) {
    bool agrees = false;
    const Eigen::Vector3d point = out.there_from_here * here.tracks[p.here].position;
    if (!is_seen_there(rig, there, place.keyframe, p.there, point, &agrees)) continue;
    ++looked_at;
    agreeing += agrees;
  }
  if (looked_at < static_cast<int>(kMinPoints) / 2 || agreeing < kSeenShare * looked_at) return std::nullopt;
  return out;
}

}  // namespace raysfm
