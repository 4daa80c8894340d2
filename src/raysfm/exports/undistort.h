#pragma once

#include <Eigen/Core>
#include <vector>

#include "raysfm/camera/pixel_finder.h"
#include "raysfm/core/result.h"
#include "raysfm/exports/export_scene.h"

namespace raysfm {

// Where a pinhole that replaces a camera, or a part of it, takes its pixels from.
class PinholeSource {
 public:
  // `from`: the camera as it is, with the skew of its pixels. Rays that do not meet in a point are followed
  // up to `distance` from their mean origin.
  PinholeSource(const Camera& from, double skew, double distance);

  // The pixel of `from` that sees along a direction from the mean origin of its rays, in its axes. False
  // where none inside its image does.
  bool pixel(const Eigen::Vector3d& direction, Eigen::Vector2d* pixel) const;
  // The direction of a pixel; false where it sees nothing.
  bool direction(const Eigen::Vector2d& pixel, Eigen::Vector3d* direction) const;

  const Camera& camera() const { return camera_; }
  // Mean origin of the rays, in the camera's frame.
  const Eigen::Vector3d& origin() const { return origin_; }
  // Largest angle of a ray off the axis z; radians.
  double widest() const { return widest_; }

 private:
  double skew_shift(double v) const;

  Camera camera_;
  PixelFinder finder_;
  double skew_ = 0, distance_ = 1;
  double fy_ = 1, cy_ = 0;  // of a lens with skew
  Eigen::Vector3d origin_ = Eigen::Vector3d::Zero();
  double widest_ = 0;
};

// A scene whose cameras are pinholes with one focal length and the principal point in the middle of the
// image, and where each takes its pixels.
struct UndistortedScene {
  ExportScene scene;
  std::vector<PinholeSource> sources;      // by camera of the scene as it was
  std::vector<int> source;                 // by camera of the new one: index into `sources`
  std::vector<Eigen::Matrix3d> rotations;  // of each new camera: axes of its source from its own
};

// Cameras that see no farther than 60 degrees off their axis become a pinhole each, of the same size and
// focal length at the middle; others a cube of faces of 90 degrees, "front", "right", "back", "left", "down"
// and "up", without those that see almost nothing. The images of a face stand in a folder of its name, in a
// rig of several cameras "<camera>_<face>". Keypoints move along; points that fewer than two of the new
// images see are left out. Errors: bad input, where the size of the images is not known or a camera sees
// nothing.
Result<UndistortedScene> undistort(const ExportScene& scene);

}  // namespace raysfm
