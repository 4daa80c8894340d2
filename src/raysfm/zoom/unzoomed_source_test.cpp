#include "raysfm/zoom/unzoomed_source.h"

#include <gtest/gtest.h>

#include <cmath>

namespace raysfm {
namespace {

constexpr int kWidth = 64, kHeight = 48;

// A bar as wide as the focal length says, in the middle; the second frame has a defect.
class ZoomedBar : public FrameSource {
 public:
  explicit ZoomedBar(std::vector<double> focals) : focals_(std::move(focals)) {}
  Result<std::optional<InputFrame>> next() override {
    if (at_ == focals_.size()) return std::optional<InputFrame>();
    InputFrame frame;
    frame.index = static_cast<int>(at_);
    const double focal = focals_[at_++];
    if (at_ == 2) {
      frame.defect = "damaged";
      return std::optional<InputFrame>(std::move(frame));
    }
    frame.gray = GrayImage(kWidth, kHeight);
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        const bool in_bar = std::abs(x - 0.5 * (kWidth - 1)) < 0.1 * focal;
        frame.gray.row(y)[x] = in_bar ? 200 : 20;
      }
    }
    return std::optional<InputFrame>(std::move(frame));
  }
  int width() const override { return kWidth; }
  int height() const override { return kHeight; }
  int frame_count() const override { return static_cast<int>(focals_.size()); }
  std::string description() const override { return "bar"; }

 private:
  std::vector<double> focals_;
  size_t at_ = 0;
};

double width_of_bar(const GrayImage& image) {
  double width = 0;
  for (int x = 0; x < image.width(); ++x) width += (image.row(image.height() / 2)[x] - 20) / 180.0;
  return width;
}

TEST(UnzoomedSource, WhatIsSeenKeepsItsSize) {
  const std::vector<double> focals = {100, 110, 130, 200, 200};
  // That of the last frame is that of the one before, where none is told.
  const UndoneZoom zoom{{100, 110, 130, 200}, 200, 2 * kWidth, 2 * kHeight};
  const auto source = unzoomed(std::make_unique<ZoomedBar>(focals), zoom);
  EXPECT_EQ(source->width(), 2 * kWidth);
  EXPECT_EQ(source->height(), 2 * kHeight);
  EXPECT_EQ(source->frame_count(), 5);
  for (size_t i = 0; i < focals.size(); ++i) {
    const auto frame = source->next();
    ASSERT_TRUE(frame && *frame) << i;
    if (i == 1) {
      EXPECT_EQ((*frame)->defect, "damaged");
      continue;
    }
    ASSERT_EQ((*frame)->gray.width(), 2 * kWidth);
    EXPECT_NEAR(width_of_bar((*frame)->gray), 0.2 * zoom.focal, 200 / focals[i] + 0.1) << i;
  }
  const auto end = source->next();
  ASSERT_TRUE(end.ok());
  EXPECT_FALSE(*end);
}

}  // namespace
}  // namespace raysfm
