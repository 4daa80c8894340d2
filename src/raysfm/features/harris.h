#pragma once

#include <memory>

#include "raysfm/features/corner_selection.h"
#include "raysfm/features/features.h"
#include "raysfm/image/image.h"

namespace raysfm {

struct HarrisOptions {
  int max_features = 1500;  // >= 0
  float k = 0.04f;          // response = det(M) - k trace(M)^2, k in [0, 0.25)
  int border = 8;           // pixels; no feature is closer to the border of the image than this, at least 5
  // Least response of a feature; M is the mean of the products of gradients in (grey levels / pixel)^2.
  // Weaker maxima are noise of the sensor.
  float min_score = 5.0f;
  // Of the features, that a cell of a grid over the image may claim: the rest goes to the strongest responses
  // anywhere.
  CellShares shares{};
  int octave = 0;   // of the image (octaves.h); the features are at pixels of octave 0
  GrayView mask{};  // of the size of octave 0: 255 where a pixel sees the scene; empty: everywhere
};

// Harris corners (LBA09 2.1; Harris and Stephens 1988), strongest of each grid cell first. The result depends
// on the image and the options alone. Owns its scratch memory, so one detector serves one thread at a time
// and allocates nothing after its first image of a size.
class HarrisDetector {
 public:
  HarrisDetector();
  ~HarrisDetector();
  HarrisDetector(HarrisDetector&&) noexcept;
  HarrisDetector& operator=(HarrisDetector&&) noexcept;

  // An image of any size; one smaller than twice the border has no features.
  void detect(const GrayView& image, const HarrisOptions& options, Features* features);

 private:
  struct Scratch;
  std::unique_ptr<Scratch> scratch_;
};

}  // namespace raysfm
