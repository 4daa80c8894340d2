#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "raysfm/core/thread_pool.h"
#include "raysfm/uncalibrated/reconstruct.h"
#include "raysfm/uncalibrated/video_radial.h"
#include "raysfm/uncalibrated/video_resection.h"

namespace raysfm {

// How a caller watches a growth and ends it early.
struct GrowthControl {
  std::function<void(int posed)> progress;  // key frames with a pose
  const std::atomic<bool>* stop = nullptr;  // set: no further key frames

  bool stopped() const { return stop && stop->load(); }
};

// Grows the reconstruction of a few key frames over all key frames of a video.
class VideoGrowth {
 public:
  // `result` has the size of the whole and holds the start; everything must outlive the object.
  VideoGrowth(const PointTracks& tracks, std::span<const uint8_t> keyframe, const SolveOptions& options,
              UncalibratedReconstruction* result);

  // Adds key frames outward from those posed, with adjustments in between.
  Result<void> grow(const GrowthControl& control);
  // The distortion of all key frames, from where they are.
  std::optional<RadialEstimate> radial() const;
  // Adjusts to the end. The result's rms_px is over the key frames.
  Result<void> finish();
  // Raises the standard deviations of the lenses to what the jackknife says: the spread of the lenses when
  // one group of tracks after the other is left out. Errors of a track, and of those beside it, are alike
  // from frame to frame, which the normal equations do not know.
  void widen_sigma(ThreadPool* pool);

 private:
  int next_keyframe() const;
  int placed_points_in(int image) const;
  bool pose(int image);
  void place_points();
  void place_points_in(int image);
  bool place(int point);
  void judge(int point);
  LensAdjustmentOptions adjustment_options() const;
  std::vector<double> robust_weights() const;
  std::vector<int> groups_by_birth() const;
  Result<void> adjust(bool last);

  const PointTracks& tracks_;
  const std::span<const uint8_t> keyframe_;
  const SolveOptions& options_;
  UncalibratedReconstruction& result_;
  PointTracks in_keyframes_;                           // the observations there, with the images of the whole
  std::vector<int> original_;                          // numbers of theirs in the whole
  std::vector<std::vector<int>> of_image_, of_point_;  // numbers of observations in the whole
  std::vector<int> seen_when_tried_;                   // placed points in an image at its last failure
};

// Poses the images that are no key frames, each near a place between its neighbours, by the placed points
// that it sees; with its own focal length where the lens zooms.
void pose_between(const PointTracks& tracks, std::span<const uint8_t> keyframe, const SolveOptions& options,
                  ThreadPool* pool, UncalibratedReconstruction* result);

}  // namespace raysfm
