#pragma once

#include <Eigen/Core>

#include "raysfm/worlds/materials.h"

namespace raysfm::synth {

// How a surface is painted: colour = tint * texture * weathering.
struct Finish {
  int texture = 0;     // in the MaterialLibrary
  float period = 0.f;  // metres of one period; 0: the texture is fitted to the surface
  Colour tint = Colour::Ones();
  float stains =
      0.35f;  // strength of noise with a period of 37 m, which tells one stretch of wall from another
  float grain = 0.25f;  // strength of noise with a period of 1.3 m, which remains when one comes near
  float shift_u = 0.f, shift_v = 0.f;  // periods; where in the pattern and in the noise the surface begins
};

// Both kinds of surface stand in the world frame: x right, y down, z forward along the street; ground at y =
// 0.

// Rectangle corner + u * right + v * down, u in [0, width], v in [0, height]; seen from both sides. The axes
// are orthogonal unit vectors.
struct Quad {
  Eigen::Vector3d corner, right, down;
  double width = 0, height = 0;  // metres, positive
  Finish finish;
};

// Points centre + axes * (radii .* unit vector); the columns of `axes` are orthonormal.
struct Ellipsoid {
  Eigen::Vector3d centre;
  Eigen::Matrix3d axes;
  Eigen::Vector3d radii;  // metres, positive
  Finish finish;
};

}  // namespace raysfm::synth
