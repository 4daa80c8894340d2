#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "raysfm/uncalibrated/reconstruct.h"
#include "raysfm/uncalibrated/video_resection.h"

namespace raysfm {

// Grows the reconstruction of a few key frames over a whole video.
class VideoGrowth {
 public:
  // `result` has the size of the whole and holds the start; everything must outlive the object.
  VideoGrowth(const PointTracks& tracks, std::span<const uint8_t> keyframe, const SolveOptions& options,
              UncalibratedReconstruction* result);

  // Adds key frames outward from those posed, adjusts, then poses the images in between. The result's
  // rms_px is over the key frames.
  Result<void> run();

 private:
  int next_keyframe(const std::vector<uint8_t>& tried) const;
  int nearest_posed(int image, int step) const;
  bool pose(int image, const Rigid3& near_pose, const Lens& near_lens, double principal_point_sigma_px);
  void place_points();
  bool place(int point);
  void find_inliers();
  Result<void> adjust(bool last);
  void pose_between();
  void measure();

  const PointTracks& tracks_;
  const std::span<const uint8_t> keyframe_;
  const SolveOptions& options_;
  UncalibratedReconstruction& result_;
  std::vector<std::vector<int>> of_image_, of_point_;  // observations
};

}  // namespace raysfm
