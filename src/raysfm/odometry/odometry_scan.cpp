// What Odometry does about rolling shutters: how fast the rig moves at a frame.

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "raysfm/core/median.h"
#include "raysfm/odometry/odometry.h"
#include "raysfm/views/scan_correction.h"

namespace raysfm {
namespace {

constexpr int kNeighbours = 2;  // frames to either side that tell how fast the rig moves at one

}  // namespace

// Of the rig at a frame, from those before it and those after it in its world; `next` is the pose of the
// frame after it where that is not recorded yet.
RigMotion Odometry::motion_of(int number, const Rigid3& rig_from_world, const Rigid3* next) const {
  const TimedPose here{frames_[number].timestamp, rig_from_world};
  const int segment = frames_[number].segment >= 0 ? frames_[number].segment : active_;
  std::vector<TimedPose> others;
  for (const int side : {-1, 1}) {
    int found = 0;
    for (int other = number + side; other >= 0 && other < frames() && found < kNeighbours; other += side) {
      const FrameRecord& frame = frames_[other];
      if (std::abs(frame.timestamp - here.time) > options_.velocity_reach) break;
      if (frame.same_as >= 0) continue;
      ++found;
      if (next && side * found == 1) {
        others.push_back({frame.timestamp, *next});
      } else if (frame.segment == segment) {
        others.push_back({frame.timestamp, present_pose(frame, segments_[segment].map)});
      } else {
        break;
      }
    }
  }
  return motion_at(here, others);
}

// Seconds from one frame to the next, in the median of the newest.
double Odometry::frame_interval() const {
  constexpr size_t kNewest = 200;
  std::vector<double> intervals;
  const FrameRecord* next = nullptr;
  for (auto frame = frames_.rbegin(); frame != frames_.rend() && intervals.size() < kNewest; ++frame) {
    if (frame->same_as >= 0) continue;
    if (next) intervals.push_back(next->timestamp - frame->timestamp);
    next = &*frame;
  }
  return intervals.empty() ? std::numeric_limits<double>::infinity() : median_of(&intervals);
}

RigMotion Odometry::present_motion(int number) const {
  return motion_of(number, present_pose(frames_[number], segments_[frames_[number].segment].map));
}

// The pose of the newest frame again, now that its motion is known better than it was foretold.
void Odometry::follow_scan(const View& view, Localisation* pose) {
  if (!rig_.scans()) return;
  pose->motion = motion_of(view.frame, pose->rig_from_world);
  localiser_.set_motion(pose->motion);
  const std::vector<TrackPixel> matches(pose->matches.begin(), pose->matches.end());
  localiser_.refine(segment().map, matches, &pose->rig_from_world, &pose->covariance);
}

// Zero at key frames of earlier runs.
RigMotion Odometry::keyframe_motion(const MapKeyFrame& keyframe) const {
  return keyframe.frame < 0 ? RigMotion{} : motion_of(keyframe.frame, keyframe.rig_from_world);
}

// Key frames that no adjustment moves any more see only new points elsewhere: they are gone through again
// now and then.
int Odometry::first_scan_to_correct() const {
  constexpr int kAllOfWindow = 4;  // with every fourth key frame
  const int count = static_cast<int>(segment().map.keyframes.size());
  const bool all = count <= options_.global_until || count % kAllOfWindow == 0;
  return count - (all ? options_.window : options_.free_cameras + 1);
}

// Of the key frames of a world from one on.
void Odometry::correct_scans(int number, int first_keyframe) {
  if (!rig_.scans()) return;
  SegmentState& s = segments_[number];
  for (int k = std::max(0, first_keyframe); k < static_cast<int>(s.map.keyframes.size()); ++k) {
    const MapKeyFrame& keyframe = s.map.keyframes[k];
    if (keyframe.frame < 0) continue;
    const bool at_hand = k < static_cast<int>(s.views.size()) && s.views[k].view;
    correct_scan(rig_, keyframe_motion(keyframe), 0, k, &s.map, at_hand ? &s.views[k] : nullptr);
  }
}

// Between two key frames of a start.
RigMotion Odometry::start_motion(int keyframe) const {
  const std::vector<MapKeyFrame>& k = segment().map.keyframes;
  const TimedPose from{frames_[k[keyframe - 1].frame].timestamp, k[keyframe - 1].rig_from_world};
  const TimedPose to{frames_[k[keyframe].frame].timestamp, k[keyframe].rig_from_world};
  return motion_at(from, std::span(&to, 1));
}

// The start was made of what corners did in the image. Now all of its frames have poses.
void Odometry::refine_start() {
  SegmentState& s = segment();
  for (int round = 0; round < 2; ++round) {
    correct_scans(world(), 0);
    const int keyframes = static_cast<int>(s.map.keyframes.size());
    for (int k = 0; k < keyframes; ++k) mapper_.triangulate_tracks(k, &s.map);
    mapper_.adjust_globally(&s.map);
    pose_frames_again(world());
  }
}

// The frames of a world that are not settled, but for key frames. Each moves with its neighbours: a pass
// leaves a quarter of what they are off by. With one, a readout and what it is measured by led each other
// astray.
void Odometry::pose_frames_again(int number) {
  constexpr int kPasses = 2;
  const std::vector<MapKeyFrame>& keyframes = segments_[number].map.keyframes;
  for (int pass = 0; pass < kPasses; ++pass) {
    for (int i = settled_before_; i < frames(); ++i) {
      if (frames_[i].segment == number && keyframes[frames_[i].keyframe].frame != i) pose_again(i);
    }
  }
}

}  // namespace raysfm
