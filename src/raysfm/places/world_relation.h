#pragma once

#include <optional>
#include <span>
#include <vector>

#include "raysfm/geometry/similarity.h"
#include "raysfm/places/place_matcher.h"

namespace raysfm {

// Two tracks that show one point.
struct SamePoint {
  int here = 0, there = 0;
};

// Where the world of one map lies in that of another, or the end of a map in what it saw long before.
struct WorldRelation {
  Similarity3 there_from_here;
  double log_scale_sigma = 0;  // 0 where the scale is known
  std::vector<SamePoint> points;
};

// Factor from lengths in one world to those in another.
struct ScaleOfWorlds {
  double scale = 1;
  double log_sigma = 0;  // standard deviation of its logarithm; 0 where the scale is known
};

// From the logarithms of the ratios of two distances of points, one in each world. With `same_scale` the
// scale of both is known, and must agree. None of too few, and where they are no ratios of one scale.
std::optional<ScaleOfWorlds> scale_of(std::vector<double> log_ratios, bool same_scale);

// Where one world lies in another, from the pose of one rig in both; without points.
WorldRelation relation_by(const Rigid3& rig_from_here, const Rigid3& rig_from_there,
                          const ScaleOfWorlds& scale);

// Whether a point of the rig is about where a camera saw it, at a pixel of an octave: the depth of a point
// that was seen from elsewhere is less sure than its direction. Of all that are looked at a share must be.
bool is_seen_about(const TrackingRig& rig, int camera, int octave, const Eigen::Vector2f& pixel,
                   const Eigen::Vector3d& in_rig);
constexpr double kSeenShare = 0.6;

// From a place of the map `there` that was recognised in what a key frame of the map `here` sees: `seen` has
// its corners with their tracks. Of both maps' points each must be where the other has it, as far as the key
// frames can tell. None where it does not hold.
std::optional<WorldRelation> relate_worlds(const TrackingRig& rig, const Map& here, int keyframe,
                                           const DescribedCorners& seen, const Map& there,
                                           const RecognisedPlace& place, bool same_scale);

// The corners of a described key frame, with its tracks.
DescribedCorners described_corners(const MapKeyFrame& keyframe);

}  // namespace raysfm
