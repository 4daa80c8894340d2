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

// Two images of a video that show one place, though tracks hardly tell so.
struct TrackBridge {
  int images[2] = {-1, -1};               // the earlier one first
  std::vector<std::pair<int, int>> same;  // points of each that are one
  // Logarithm to base 10 of the number of epipolar geometries that wrong matches would agree on so well.
  double log10_false_alarms = 0;
};

// Bridges where tracks do not tie a video together: of images that look alike, or that follow one another,
// but share few points, the pairs of which far more points agree with an epipolar geometry than would by
// chance. `described`: in the order of time. `is_posed`: one per image of the tracks, 1 for those that need
// no bridge to one another; empty: none is. In the order of their images, the same on any number of threads.
// `stop`: set or null; there are none then.
std::vector<TrackBridge> find_bridges(const PointTracks& tracks, std::span<const DescribedImage> described,
                                      std::span<const uint8_t> is_posed, double max_error_px, uint64_t seed,
                                      const std::atomic<bool>* stop, ThreadPool* pool);

// Makes one of the points that bridges tell are one, the surest first, unless an image sees both. The value
// is the new number of each point, of which there are fewer.
std::vector<int> join_points(std::span<const TrackBridge> bridges, PointTracks* tracks);

}  // namespace raysfm
