#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "raysfm/geometry/pose.h"
#include "raysfm/geometry/ray.h"
#include "raysfm/models/double_sphere.h"
#include "raysfm/models/equirectangular.h"
#include "raysfm/models/eucm.h"
#include "raysfm/models/kannala_brandt.h"
#include "raysfm/models/mirror.h"
#include "raysfm/models/ocam.h"
#include "raysfm/models/pinhole.h"
#include "raysfm/models/radtan.h"
#include "raysfm/models/rational.h"
#include "raysfm/models/ray_table.h"
#include "raysfm/models/unified.h"

namespace raysfm {

// Every model there is (models/model.h says what each has).
using CameraModel = std::variant<Pinhole, Radtan, Rational, KannalaBrandt, Unified, DoubleSphere, Eucm, OCam,
                                 Equirectangular, Mirror, CentralRayTable, NonCentralRayTable>;

// Rectangle of pixels of a stream that a camera's image is; empty (w = 0) stands for the whole image. A
// camera with a roi has width = w and height = h, and its pixels are counted from the corner (x, y).
struct Roi {
  int x = 0, y = 0, w = 0, h = 0;
};

// Rows of an image, or columns, exposed one after another.
struct RollingShutter {
  enum class Direction : uint8_t { kDown, kUp, kRight, kLeft };  // in which the exposure moves on
  double readout = 0;  // seconds from the first row to the last, >= 0; 0: all at once
  Direction direction = Direction::kDown;
};

// One camera of a rig: a function from pixels to rays, and back where the model can project.
struct Camera {
  std::string name;
  CameraModel model;
  int width = 0;   // pixels
  int height = 0;  // pixels
  Rigid3 rig_from_cam;
  int stream = 0;
  Roi roi;
  std::string mask_path;  // empty: none
  RollingShutter shutter;

  // Ray of a pixel in the camera's frame. False where the pixel sees nothing (outside the valid set).
  bool ray(const Eigen::Vector2d& pixel, Ray* ray) const;

  // Pixel of a point in the camera's frame. False, leaving the outputs unspecified, where the point is
  // outside the valid set of the model (behind a perspective camera, or beyond the monotonic range of the
  // distortion). The pixel may lie outside the image. `jacobian`, when not null, is d pixel / d point.
  bool project(const Eigen::Vector3d& point_in_cam, Eigen::Vector2d* pixel,
               Eigen::Matrix<double, 2, 3>* jacobian = nullptr) const;

  // Whether the model projects: whether project() can ever be true. Where it cannot, PixelFinder searches.
  bool can_project() const;

  // Seconds from the instant of the frame, at which the middle of the image is exposed, to that of a pixel.
  double exposed_after(const Eigen::Vector2d& pixel) const;

  bool contains(const Eigen::Vector2d& pixel) const {
    return pixel.x() >= -0.5 && pixel.y() >= -0.5 && pixel.x() < width - 0.5 && pixel.y() < height - 0.5;
  }

  // Pixels. What is a part of the image is one of this, however the camera is held.
  int longer_side() const { return std::max(width, height); }

  // Pixels per radian near the centre of the image: the conversion between pixel and angular thresholds.
  // Zero where no pixel sees anything.
  double pixels_per_radian() const;
};

// Cameras that move together; poses of a rig are rig_from_world / world_from_rig. A monocular camera is a rig
// of one.
struct Rig {
  std::vector<Camera> cameras;
};

// Name of the model as in the camera file, e.g. "radtan".
std::string_view model_name(const CameraModel& model);

}  // namespace raysfm
