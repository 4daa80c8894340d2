#pragma once

#include <string>
#include <vector>

#include "raysfm/camera/pixel_finder.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// What is to be drawn over the picture of a frame, as LBA09 figure 1 has it.
class FrameFeatures {
 public:
  // `reconstruction` outlives it.
  explicit FrameFeatures(const Reconstruction& reconstruction);

  // JSON: `size` of the image in pixels; `tracks`, each a list u, v, u, v, ... of pixels: where a point is in
  // the frame, and where it was in the frames before, the newest first, at most eight; `seen`, how many of
  // these, the first, were matched in the frame, which is a key frame then. Of other frames it is where the
  // points of the key frames before and after it are expected. Empty lists where the frame has no pose or its
  // camera is not known.
  std::string json(int frame, int camera) const;

 private:
  struct Feature {
    int point = 0;
    Eigen::Vector2d pixel;
  };

  std::vector<Feature> matched(const KeyFrame& keyframe, int camera) const;
  std::vector<Feature> expected(int frame, int camera) const;
  std::vector<double> track(const Feature& feature, int frame, int camera) const;
  bool project(int frame, int camera, int point, Eigen::Vector2d* pixel) const;

  const Reconstruction& r_;
  std::vector<PixelFinder> finders_;             // of the rig's cameras
  std::vector<const KeyFrame*> before_, after_;  // of each frame, in its world; null: none
};

}  // namespace raysfm
