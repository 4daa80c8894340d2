#pragma once

#include <optional>
#include <span>
#include <vector>

#include "raysfm/places/world_relation.h"

namespace raysfm {

// A key frame of one map that was posed in another one as well.
struct SharedView {
  int keyframe = 0;
  Rigid3 rig_from_there;            // its pose in the world of the other map
  std::vector<TrackPixel> matches;  // points of the other map, where it shows them
  // Where it would show them at the instant of the frame, as MapKeyFrame has it.
  std::vector<Eigen::Vector2f> instant_pixels;
};

// A point of the other map in the shared views.
struct SharedPoint {
  int there = 0;             // its track in the other map
  int here = -1;             // that of the corner at the same place, which has a position; -1: there is none
  Eigen::Vector3d position;  // in the world `here`
};

struct SharedPoints {
  WorldRelation relation;           // without points
  std::vector<SharedPoint> points;  // by their tracks there
};

// From what two or more key frames of the map `here` show of the map `there`: points that have a position
// here too, by the corner that is seen at the same place or by the rays of the shared views. Their distances
// tell the scale, as in relate_worlds(). None where that does not hold: where they tell no one scale, or most
// points are not where the key frames see them.
std::optional<SharedPoints> relate_by_views(const TrackingRig& rig, const Map& here, const Map& there,
                                            std::span<const SharedView> views, bool same_scale);

}  // namespace raysfm
