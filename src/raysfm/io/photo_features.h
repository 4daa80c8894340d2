#pragma once

#include <Eigen/Core>
#include <memory>
#include <utility>
#include <vector>

#include "raysfm/image/image.h"

namespace raysfm {

// Interest points of photos that bear large changes of place, scale and orientation (SIFT, Lowe 2004), and
// their matches.
class PhotoFeatures {
 public:
  PhotoFeatures();
  ~PhotoFeatures();
  PhotoFeatures(const PhotoFeatures&) = delete;
  PhotoFeatures& operator=(const PhotoFeatures&) = delete;

  // The next photo and at most `max_features` of its points, the strongest; max_features > 0. A photo without
  // pixels has none.
  void add(const GrayView& image, int max_features);
  int photos() const;
  // Pixels of the points of a photo; centre of the first pixel at (0, 0).
  const std::vector<Eigen::Vector2d>& pixels(int photo) const;
  // Points of photo a and photo b that prefer each other clearly to all others.
  std::vector<std::pair<int, int>> match(int a, int b) const;

 private:
  struct Photos;
  std::unique_ptr<Photos> photos_;
};

}  // namespace raysfm
