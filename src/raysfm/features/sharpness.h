#pragma once

#include <algorithm>
#include <cmath>

#include "raysfm/image/image.h"

namespace raysfm {

// Widths of the sharper edges of an image along its rows and along its columns: the standard deviation, in
// pixels, of the Gaussian blur that would make of a step what the lower quartile of the edges with a good
// contrast are. 0.4 to 0.8 where a camera's pixels are used to the full, larger by the factor of an
// enlargement, sqrt(w^2 + s^2) after a blur by s, 0.4 L after a motion by L. 0 where too few edges tell it.
struct EdgeWidths {
  float along_rows = 0, along_columns = 0;

  // A picture of stripes tells one direction only.
  float mean() const {
    const bool both = along_rows > 0 && along_columns > 0;
    return both ? std::sqrt(along_rows * along_columns) : wider();
  }
  // Along a motion of the camera.
  float wider() const { return std::max(along_rows, along_columns); }
};

// Looks at a few rows and columns, so that it costs little at any size.
EdgeWidths edge_widths(const GrayView& image);

inline float edge_width(const GrayView& image) {
  return edge_widths(image).mean();
}

}  // namespace raysfm
