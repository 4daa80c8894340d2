#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "raysfm/camera/camera.h"

namespace raysfm {

// How the pixels of a camera lie on the sphere of its rays' directions, to second order: the Christoffel
// symbols of this map (do Carmo, Differential Geometry of Curves and Surfaces, 4-3). For a step w of a pixel,
//   direction(pixel + w) = direction + D (w + gamma(w, w) / 2) - |D w|^2 / 2 direction,
// D = d direction / d pixel. From a table of the camera's rays; that their origins differ is left out, which
// matters only for points about as near as the origins are apart. Thread-safe, no allocation but in the
// constructor, which asks for up to 17,000 rays.
class PixelCurvature {
 public:
  explicit PixelCurvature(const Camera& camera);

  // Mean origin of the rays, in the camera's frame.
  const Eigen::Vector3d& centre() const { return centre_; }

  // The sum of gamma(w, w) over steps w, of which `moments` is the sum of w w^T; pixels. Of a pixel outside
  // the image that of the nearest inside, and zero far from all that see anything.
  Eigen::Vector2d along(const Eigen::Vector2d& pixel, const Eigen::Matrix2d& moments) const;

 private:
  using Symbols = Eigen::Matrix<float, 2, 3>;  // by pixel of the ray; columns xx, xy, yy

  void fill_gaps(std::vector<uint8_t> known);

  int columns_ = 0, rows_ = 0;  // of the table, at least 2
  Eigen::Vector2d spacing_;     // pixels between its nodes, of which the first lies at (-0.5, -0.5)
  std::vector<Symbols> table_;  // row by row
  Eigen::Vector3d centre_;
};

}  // namespace raysfm
