#pragma once

#include <Eigen/Core>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "raysfm/camera/camera.h"
#include "raysfm/core/result.h"

namespace raysfm {

// Names and values of a model's parameters; none for a table.
std::vector<std::pair<std::string_view, double>> camera_parameters(const CameraModel& model);

// What can be said of a camera from its rays, whatever its model. Measured on a grid of pixels; angles in
// degrees; NaN where no ray tells.
struct CameraFacts {
  double valid_share = 0;  // of the pixels, those that have a ray
  // Angles swept along the middle row, the middle column and the longer of the two diagonals, where there are
  // rays; up to 360.
  double fov_horizontal_deg, fov_vertical_deg, fov_diagonal_deg;
  double max_angle_deg;             // largest angle of a ray from the camera's z axis
  double centre_pixels_per_degree;  // of the ray nearest to the middle of the image
  double min_pixels_per_degree, max_pixels_per_degree;
  // Largest distance between a pixel and where its ray is seen again, pixels: at distance 1 and 10 along it.
  double round_trip_px;
  double round_trip_failures;  // share of the rays whose points are not seen again
  bool folds = false;          // neighbouring pixels see in the wrong order somewhere
  bool mirrored = false;       // the image is a mirror image of the world
  bool central = true;
};

// A camera with a size, `width` > 0.
CameraFacts camera_facts(const Camera& camera);

// What is suspicious about a rig, one sentence each, beginning with the name of the camera. A rig that was
// read from a file; cameras without a size are judged by their numbers alone.
std::vector<std::string> camera_warnings(const Rig& rig);

// Those of them that are about cameras in one place, on the same images, or far apart.
std::vector<std::string> place_warnings(const Rig& rig);

// What a file cannot tell about the places of its cameras and the user has to check: one sentence for each
// camera but the first, saying where it stands and looks according to the rig.
std::vector<std::string> placements(const Rig& rig);

// The rays of two descriptions of one camera. Sizes may differ in scale.
struct CameraComparison {
  int rays = 0;                                  // compared: pixels that see something in both
  double rotation_deg = 0;                       // of the common rotation taken out
  double median_px = 0, p95_px = 0, max_px = 0;  // difference of the rays in pixels of the first camera
};

// Compares directions after the rotation that makes them agree best (least sum of angles); each camera's
// place in its rig and the origins of non-central rays are not looked at. Errors: bad input, where the sizes
// are no scaled copies of each other or no pixel sees something in both.
Result<CameraComparison> compare_cameras(const Camera& a, const Camera& b);

}  // namespace raysfm
