#pragma once

#include "raysfm/image/color_planes.h"
#include "raysfm/image/image.h"

namespace raysfm {

// Where an image goes on a larger or smaller canvas: enlarged by `scale` > 0, the middle of one on the middle
// of the other.
struct CanvasPlace {
  double scale = 1;
  int width = 0, height = 0;  // of the canvas, pixels, >= 1

  // Of a pixel of an image of this size, on the canvas, and back; along one axis, whose sides are given.
  double onto(double pixel, int image_side, int canvas_side) const {
    return (canvas_side - 1) / 2.0 + scale * (pixel - (image_side - 1) / 2.0);
  }
  double back(double pixel, int image_side, int canvas_side) const {
    return (image_side - 1) / 2.0 + (pixel - (canvas_side - 1) / 2.0) / scale;
  }
};

// The canvas: bilinear, of the means of blocks where the image shrinks to less than a half. Where the image
// does not reach, its border goes on, so that there are edges along the border but no corners.
GrayImage on_canvas(const GrayView& image, const CanvasPlace& place);

// The colours of an image on the same canvas, those of the nearest pixel in every fourth; empty where there
// are none. `gray`: of the image.
ColorPlanes on_canvas(const ColorPlanes& colors, const GrayView& gray, const CanvasPlace& place);

}  // namespace raysfm
