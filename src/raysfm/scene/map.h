#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <deque>
#include <limits>
#include <vector>

#include "raysfm/camera/observed_ray.h"
#include "raysfm/core/slab_allocator.h"
#include "raysfm/features/descriptor.h"
#include "raysfm/geometry/pose.h"

namespace raysfm {

// Standard deviation of the logarithm of a scale below which it is called metric.
constexpr double kMetricSigma = 0.02;

// What stays as long as the map.
template <typename T>
using MapArray = std::vector<T, SlabAllocator<T>>;

// Where a track was seen: feature `feature` of key frame `keyframe`.
struct TrackObservation {
  int keyframe = 0;
  int feature = 0;
};

// A map point seen in an image.
struct TrackPixel {
  int track = 0;
  uint8_t camera = 0;
  uint8_t octave = 0;  // that the pixel was measured in
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();
};

// One scene point as followed through the key frames, with a position once it could be triangulated.
struct Track {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // world; meaningless until triangulated
  bool triangulated = false;
  std::array<uint8_t, 3> rgb = {128, 128, 128};
  bool had_position = false;  // frames may refer to it even where it has none now
  // Ascending key frames, at most one in each of their cameras.
  MapArray<TrackObservation> observations = {};
};

// A key frame of the map; the arrays run over its features.
struct MapKeyFrame {
  int frame = 0;  // index of the input frame
  Rigid3 rig_from_world;
  MapArray<uint8_t> cameras;         // of the rig, that the feature is seen in
  MapArray<Eigen::Vector2f> pixels;  // sub-pixel positions, as the image shows them
  // By how much a rolling shutter moved each of these from where it would be had all been exposed at the
  // instant of the frame, which the pose is of. Empty: by nothing.
  MapArray<Eigen::Vector2f> scan_offsets;
  MapArray<uint8_t> octaves;   // of the image (features/octaves.h), in which these were found
  MapArray<int> tracks;        // track seen there
  MapArray<uint8_t> inliers;   // 1 while the observation agrees with its track's position
  MapArray<ObservedRay> rays;  // where residuals are angular; else empty

  // What the place is recognised by: some of its features, ascending, and what each looks like. Empty where
  // the key frame shows little that others do not.
  MapArray<int> described;
  MapArray<Descriptor> descriptors;

  int size() const { return static_cast<int>(pixels.size()); }
  // Where a feature would be at the instant of the frame: what geometry is about.
  Eigen::Vector2f instant_pixel(int f) const { return at_instant(f, pixels[f]); }
  // The same if it were seen at another pixel.
  Eigen::Vector2f at_instant(int f, const Eigen::Vector2f& pixel) const {
    return scan_offsets.empty() ? pixel : Eigen::Vector2f(pixel - scan_offsets[f]);
  }
  int add(int camera, const Eigen::Vector2f& pixel, int octave, int track) {
    cameras.push_back(static_cast<uint8_t>(camera));
    pixels.push_back(pixel);
    octaves.push_back(static_cast<uint8_t>(octave));
    tracks.push_back(track);
    inliers.push_back(1);
    if (!scan_offsets.empty()) scan_offsets.emplace_back(Eigen::Vector2f::Zero());
    return size() - 1;
  }
};

// The world of one segment.
struct Map {
  std::vector<MapKeyFrame> keyframes;  // in time order
  std::deque<Track, SlabAllocator<Track>> tracks;
  std::vector<int> free_tracks;  // indices of tracks that were given up
  // Standard deviation of the logarithm of the scale, by which the map is in the unit of the rig's
  // calibration; infinite where nothing tells it.
  double scale_sigma = std::numeric_limits<double>::infinity();
  // Where the start did not tell the scale, the distance from key frame 0 to this one stands for it, and is
  // held until enough has been seen to measure it.
  int guessed_keyframe = -1;
  double guessed_distance = 0;
  double rescaled = 1;  // factor between the map as it was started and as it is

  // Index of a track without observations.
  int new_track() {
    if (free_tracks.empty()) {
      tracks.emplace_back();
      return static_cast<int>(tracks.size()) - 1;
    }
    const int track = free_tracks.back();
    free_tracks.pop_back();
    return track;
  }
  void free_track(int track) {
    tracks[track] = {};
    free_tracks.push_back(track);
  }

  void observe(int track, int keyframe, int feature) {
    tracks[track].observations.push_back({keyframe, feature});
  }
};

}  // namespace raysfm
