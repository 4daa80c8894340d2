#include "raysfm/features/octaves.h"

#include <utility>

#include "raysfm/features/sharpness.h"
#include "raysfm/image/noise.h"
#include "raysfm/image/pyramid.h"

namespace raysfm {
namespace {

// Beyond this width of its edges, in pixels, an image says no more than its half.
constexpr float kSoftEdge = 1.5f;
// Nor where a motion drew edges out to this width, nine pixels of it. Corners are then where streaks begin or
// end, by half the motion from the middle of the exposure, and go their own way when it changes. Turns of 200
// degrees a second at the corners of a corridor change the scale by 1 % at 2.5, 1.5 % at 3.5, 7 % without a
// bound; below 3, footage that is blurred all along (fr1-rpy) starts late or never.
constexpr float kMotionBlur = 3.5f;
constexpr int kCoarser = 3;   // octaves above the first: for patches seen from afar
constexpr int kMinSide = 48;  // pixels

}  // namespace

Octaves::Octaves(GrayImage image, int max_pixels) {
  const auto has_half = [](const GrayImage& i) { return std::min(i.width(), i.height()) >= 2 * kMinSide; };
  GrayImage half;
  const auto go_on_with_half = [&] {
    image = std::exchange(half, GrayImage{});
    ++first_;
  };
  while (has_half(image) && int64_t{image.width()} * image.height() > max_pixels) {
    half_sample(image.view(), &half);
    go_on_with_half();
  }
  subdue_noise(&image);
  EdgeWidths widths = edge_widths(image.view());
  while (has_half(image)) {
    half_sample(image.view(), &half);
    const EdgeWidths of_half = edge_widths(half.view());
    // Noise breaks what was drawn out far into short slopes; less so in the half.
    const float drawn_out = 2 * of_half.wider();
    motion_blur_ = drawn_out * octave_side(first_);
    if (widths.mean() <= kSoftEdge && drawn_out <= kMotionBlur) break;
    go_on_with_half();
    widths = of_half;
  }
  softness_ = widths.mean();
  images_.push_back(std::move(image));
  if (!half.view().empty()) images_.push_back(std::move(half));
  while (static_cast<int>(images_.size()) <= kCoarser && has_half(images_.back())) {
    GrayImage& next = images_.emplace_back();
    half_sample(images_[images_.size() - 2].view(), &next);
  }
}

Octaves Octaves::without_finest(int octaves) const {
  const int gone = std::min(octaves, static_cast<int>(images_.size()) - 1);
  Octaves coarser;
  coarser.first_ = first_ + gone;
  coarser.softness_ = softness_;
  coarser.motion_blur_ = motion_blur_;
  for (auto image = images_.begin() + gone; image != images_.end(); ++image) {
    GrayImage& copy = coarser.images_.emplace_back(image->width(), image->height());
    std::copy_n(image->row(0), image->view().stride * image->height(), copy.row(0));
  }
  return coarser;
}

std::vector<GrayView> Octaves::views() const {
  std::vector<GrayView> views;
  for (const GrayImage& image : images_) views.push_back(image.view());
  return views;
}

size_t Octaves::bytes() const {
  size_t bytes = 0;
  for (const GrayImage& image : images_) bytes += image.view().stride * image.height();
  return bytes;
}

}  // namespace raysfm
