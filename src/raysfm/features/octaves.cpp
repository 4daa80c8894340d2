#include "raysfm/features/octaves.h"

#include <utility>

#include "raysfm/features/sharpness.h"
#include "raysfm/image/blur.h"
#include "raysfm/image/noise.h"
#include "raysfm/image/pyramid.h"

namespace raysfm {
namespace {

// Beyond this width of its edges, in pixels, an image says no more than its half.
constexpr float kSoftEdge = 1.5f;
constexpr int kCoarser = 3;   // octaves above the first: for patches seen from afar
constexpr int kMinSide = 48;  // pixels
// Noise, as a part of the contrast, beyond which corners would be those of the noise, and patches of the same
// place unlike: the image is blurred by one pixel, however noisy, as images that are to be matched should be
// alike.
constexpr double kNoisy = 0.3;

void blur_noise(GrayImage* image) {
  if (noise_share(image->view()) <= kNoisy) return;
  GrayImage once;
  blur3(image->view(), &once);
  blur3(once.view(), image);
}

}  // namespace

Octaves::Octaves(GrayImage image, int max_pixels) {
  blur_noise(&image);
  const auto has_half = [](const GrayImage& i) { return std::min(i.width(), i.height()) >= 2 * kMinSide; };
  for (;; ++first_) {
    const bool too_large = int64_t{image.width()} * image.height() > max_pixels;
    softness_ = too_large ? 0 : edge_width(image.view());
    if (!has_half(image) || (!too_large && softness_ <= kSoftEdge)) break;
    GrayImage half;
    half_sample(image.view(), &half);
    image = std::move(half);
  }
  images_.push_back(std::move(image));
  while (static_cast<int>(images_.size()) <= kCoarser && has_half(images_.back())) {
    GrayImage& next = images_.emplace_back();
    half_sample(images_[images_.size() - 2].view(), &next);
  }
}

std::vector<GrayView> Octaves::views() const {
  std::vector<GrayView> views;
  for (const GrayImage& image : images_) views.push_back(image.view());
  return views;
}

}  // namespace raysfm
