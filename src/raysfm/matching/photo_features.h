#pragma once

#include <Eigen/Core>
#include <memory>
#include <utility>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/features/descriptor.h"
#include "raysfm/image/image.h"

namespace raysfm {

// Interest points of photos that bear large changes of place, scale and orientation (SIFT, Lowe 2004), and
// their matches.
class PhotoFeatures {
 public:
  virtual ~PhotoFeatures() = default;

  // The next photo and at most `max_features` of its points, the strongest; max_features > 0. A photo without
  // pixels has none. Errors: internal, where memory is short.
  virtual Result<void> add(const GrayView& image, int max_features) = 0;
  virtual int photos() const = 0;
  // Pixels of the points of a photo; centre of the first pixel at (0, 0).
  virtual const std::vector<Eigen::Vector2d>& pixels(int photo) const = 0;
  // Points of photo a and photo b that prefer each other clearly to all others: seen from either, the other
  // one is at less than `max_ratio` (0 to 1) of the distance of the second best.
  // Any number of threads may ask at a time.
  virtual std::vector<std::pair<int, int>> match(int a, int b, float max_ratio) const = 0;
  // What the points of a photo look like, in 256 bits each, for an index of many photos.
  virtual std::vector<Descriptor> codes(int photo) const = 0;
};

// SIFT. Errors: internal, where its module cannot be loaded.
Result<std::unique_ptr<PhotoFeatures>> make_photo_features();

}  // namespace raysfm
