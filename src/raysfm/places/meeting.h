#pragma once

#include <optional>
#include <span>
#include <vector>

#include "raysfm/places/map_fusion.h"
#include "raysfm/places/place_matcher.h"
#include "raysfm/places/world_relation.h"
#include "raysfm/scene/map_measures.h"

namespace raysfm {

// A place that can be recognised: a described key frame of a world.
struct PlaceRef {
  int world = 0;
  int keyframe = 0;
};

// A place seen again from a key frame, of its own world or of another.
struct Meeting {
  PlaceRef here, there;
  RecognisedPlace place;
  WorldRelation relation;
};

// The map of each world, by number.
using WorldMaps = std::span<Map* const>;

// Whether the scales of two worlds are both told, so that they are one.
bool has_same_scale(const TrackingRig& rig, const Map& a, const Map& b);

// How many points of a key frame each key frame of the map sees, itself among them.
std::vector<int> shared_points(const Map& map, int keyframe);

// How many points a key frame sees, and how many of these another one sees too: what shared_points() has for
// the two, in less time.
struct SeenAndShared {
  int seen = 0, shared = 0;
};
SeenAndShared seen_and_shared(const Map& map, int keyframe, int other);

// Of two key frames of one world, the earlier one `there`: whether the path between may have drifted so far.
bool is_plausible(const Meeting& meeting, const Map& map);

// Whether it has drifted by no more than paths usually do. A street that repeats itself looks as if it had
// drifted by more, however clearly.
bool is_usual(const Meeting& meeting, const Map& map);

// Whether two meetings of the same worlds tell the same; `here` is that of meeting.here.
bool tell_the_same(const Meeting& meeting, const Meeting& before, const Map& here);

// Of two key frames of one world: whether their points disagree by so much that the drift between has to be
// spread over the path. Else they need only be brought together.
bool is_bent(const Meeting& meeting, const TrackingRig& rig, const Map& map);

// Spreads that drift.
void straighten(const Meeting& meeting, const TrackingRig& rig, Map* map);

// Whether straighten() has brought the two together but for what the adjustment of the newest key frames,
// which takes those of the place in, can do.
bool is_straight(const Meeting& meeting, const TrackingRig& rig, const Map& map);

// Whether nearly all key frames have their points where they see them, so that tracking loses none of these.
bool fits_together(const TrackingRig& rig, const Map& map);

// What became of two worlds that were joined: the later one went into the earlier one.
struct JoinedWorlds {
  int first = 0, second = 0;      // the earlier world, and the one that is empty now
  bool here_is_first = false;     // the key frame that met the other was of the first world
  Similarity3 first_from_second;  // in the unit of the joined world
  double first_rescaled = 1;  // factor of the first world's lengths: the better known scale is that of both
  JoinedNumbers numbers;
  std::vector<SamePoint> points;  // in the joined map, not fused yet; `there` goes on
};

// Makes one map of those of the two worlds that met.
JoinedWorlds join_worlds(const Meeting& meeting, WorldMaps worlds);

}  // namespace raysfm
