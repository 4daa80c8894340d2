#pragma once

#include <algorithm>
#include <memory>
#include <vector>

#include "raysfm/frames/frame_source.h"
#include "raysfm/image/canvas.h"

namespace raysfm {

// A canvas on which all frames of a camera that zooms have one focal length.
struct UndoneZoom {
  std::vector<double> focals;  // of each frame as it was taken, pixels, > 0; empty: it does not zoom
  double focal = 0;            // on the canvas
  int width = 0, height = 0;   // of the canvas

  bool any() const { return !focals.empty(); }
  // Of the last frame that has a focal length, of those after it too.
  CanvasPlace place(size_t frame) const {
    return {focal / focals[std::min(frame, focals.size() - 1)], width, height};
  }
};

// The frames of `source` on the canvas (image/canvas.h). `zoom.any()`.
std::unique_ptr<FrameSource> unzoomed(std::unique_ptr<FrameSource> source, UndoneZoom zoom);

}  // namespace raysfm
