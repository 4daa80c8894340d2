#pragma once

#include <span>
#include <vector>

#include "raysfm/geometry/similarity.h"
#include "raysfm/places/world_relation.h"
#include "raysfm/scene/map.h"

namespace raysfm {

// Numbers of what was joined, in the joined map: key frames by their old numbers, and the first track of the
// second map, which the others follow.
struct JoinedNumbers {
  std::vector<int> keyframe_of_first, keyframe_of_second;
  int first_track_of_second = 0;
};

// Makes one map of two, in the world of the first: key frames in the order of their frames, tracks of the
// second behind those of the first. What both say of scales is the first's.
JoinedNumbers join_maps(const Similarity3& first_from_second, Map second, Map* first);

// Moves all of a map to another world.
void transform_map(const Similarity3& b_from_a, Map* map);

// Whether a camera of a key frame sees a track.
bool is_observed(const Map& map, int track, int keyframe, int camera);

// Makes one track of two that show one point: `kept` has the observations of both, at most one in each camera
// of a key frame, and `gone` may be used again: nothing must name it any more. Both may be the same: nothing
// happens then.
void fuse_tracks(int kept, int gone, Map* map);

// Makes one track of each two that show one point: `there` goes on, where neither was fused already. Returns
// by which number what names a track has to name it now.
std::vector<int> fuse_points(std::span<const SamePoint> points, Map* map);

}  // namespace raysfm
