#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "raysfm/core/result.h"

namespace raysfm {

// Points seen in images. Observation k: point[k] is seen in image[k] at pixel[k]; the three arrays have one
// length, in any order, no (image, point) twice. Nothing needs every point in every image.
struct PointTracks {
  int image_count = 0;
  int point_count = 0;
  Eigen::Vector2d image_size = Eigen::Vector2d::Zero();  // pixels, > 0; the same for every image
  std::vector<int> image;                                // [0, image_count)
  std::vector<int> point;                                // [0, point_count)
  std::vector<Eigen::Vector2d> pixel;                    // finite

  int size() const { return static_cast<int>(image.size()); }
  Eigen::Vector2d centre() const { return 0.5 * (image_size - Eigen::Vector2d::Ones()); }
  void add(int in_image, int of_point, const Eigen::Vector2d& at) {
    image.push_back(in_image);
    point.push_back(of_point);
    pixel.push_back(at);
  }
};

// Names the observation (counted from 0), the value and what is allowed.
Result<void> validate(const PointTracks& tracks);

// The observations of some images alone (`images`: one mark each), of points that at least `least` of these
// see; all keep their numbers. `observations`: which of `tracks` each is; may be null.
PointTracks seen_by(const PointTracks& tracks, std::span<const uint8_t> images, int least,
                    std::vector<int>* observations);

// Positions of points, and marks of those that have one, where tracks have got other numbers. `number`: one
// per track as it was, -1 for one that is gone; of several that are one now the first that has a position
// counts. `count`: tracks now.
void renumber_points(std::span<const int> number, int count, std::vector<Eigen::Vector3d>* points,
                     std::vector<uint8_t>* placed);

}  // namespace raysfm
