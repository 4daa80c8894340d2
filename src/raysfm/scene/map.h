#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "raysfm/geometry/pose.h"

namespace raysfm {

// Where a track was seen: feature `feature` of key frame `keyframe`.
struct TrackObservation {
  int keyframe = 0;
  int feature = 0;
};

// One scene point as followed through the key frames, with a position once it could be triangulated.
struct Track {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // world; meaningless until triangulated
  bool triangulated = false;
  std::array<uint8_t, 3> rgb = {128, 128, 128};
  std::vector<TrackObservation> observations;  // ascending key frames, at most one in each
};

// A key frame of the map; the four arrays run over its features.
struct MapKeyFrame {
  int frame = 0;  // index of the input frame
  Rigid3 rig_from_world;
  std::vector<Eigen::Vector2f> pixels;  // sub-pixel positions
  std::vector<int> tracks;              // track seen there
  std::vector<uint8_t> inliers;         // 1 while the observation agrees with its track's position

  int size() const { return static_cast<int>(pixels.size()); }
  int add(const Eigen::Vector2f& pixel, int track) {
    pixels.push_back(pixel);
    tracks.push_back(track);
    inliers.push_back(1);
    return size() - 1;
  }
};

// The world of one segment.
struct Map {
  std::vector<MapKeyFrame> keyframes;  // in time order
  std::vector<Track> tracks;

  void observe(int track, int keyframe, int feature) {
    tracks[track].observations.push_back({keyframe, feature});
  }
};

}  // namespace raysfm
