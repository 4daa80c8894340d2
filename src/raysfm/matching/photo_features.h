#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/features/descriptor.h"
#include "raysfm/image/image.h"

namespace raysfm {

// Points of two photos that prefer each other to all others: their numbers, and the distance between the two
// as a part of that to the second best, seen from the one of which this is more. 0 to 1; the less the
// clearer.
struct PhotoMatch {
  int in_a, in_b;
  float ratio;

  bool operator==(const PhotoMatch&) const = default;
};

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
  // Matches of photo a and photo b whose ratio is less than `max_ratio`, 0 to 1, in the order of the points
  // of a. Any number of threads may ask at a time.
  virtual std::vector<PhotoMatch> match(int a, int b, float max_ratio) const = 0;
  // What the points of a photo look like, in 256 bits each, for an index of many photos.
  virtual std::vector<Descriptor> codes(int photo) const = 0;
};

// SIFT. Errors: internal, where its module cannot be loaded.
Result<std::unique_ptr<PhotoFeatures>> make_photo_features();

}  // namespace raysfm
