#pragma once

#include <atomic>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "raysfm/core/thread_pool.h"
#include "raysfm/features/descriptor.h"
#include "raysfm/lenses/point_tracks.h"

namespace raysfm {

// What points of tracks look like in an image.
struct DescribedImage {
  int image = -1;
  std::vector<int> points;              // ascending
  std::vector<Descriptor> descriptors;  // one per point
};

// Two images of different stretches of a video that show one place.
struct TrackBridge {
  int images[2] = {-1, -1};               // the earlier one first
  std::vector<std::pair<int, int>> same;  // points of each that are one
  // Logarithm to base 10 of the number of epipolar geometries that wrong matches would agree on so well.
  double log10_false_alarms = 0;
};

// The stretch of each of `images`, which are in the order of time: a new one begins where an image hardly sees
// a point of the few images before it.
std::vector<int> stretches_of(const PointTracks& tracks, std::span<const int> images);

// Bridges between the stretches of a video: of images that look alike, and of those at the ends of stretches
// that follow each other, the pairs of which far more points agree with an epipolar geometry than would by
// chance. `described`: in the order of time. In the order of their images, the same on any number of threads.
// `stop`: set or null; there are none then.
std::vector<TrackBridge> find_bridges(const PointTracks& tracks, std::span<const DescribedImage> described,
                                      double max_error_px, uint64_t seed, const std::atomic<bool>* stop,
                                      ThreadPool* pool);

// Makes one of the points that bridges tell are one, the surest first, unless an image sees both. The value
// is the new number of each point, of which there are fewer.
std::vector<int> join_points(std::span<const TrackBridge> bridges, PointTracks* tracks);

}  // namespace raysfm
