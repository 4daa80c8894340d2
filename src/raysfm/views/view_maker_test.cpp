#include "raysfm/views/view_maker.h"

#include <gtest/gtest.h>

#include <utility>

#include "support/texture.h"

namespace raysfm {
namespace {

constexpr int kWidth = 160, kHeight = 96;

// Two cameras side by side in a coloured picture, and one with a grey picture of its own.
ViewMaker three_cameras() {
  const HarrisOptions harris{.max_features = 80};
  return ViewMaker({{0, {0, 0, 80, kHeight}, harris}, {1, {}, harris}, {0, {80, 0, 80, kHeight}, harris}});
}

std::vector<Picture> pictures() {
  std::vector<Picture> out(2);
  out[0].gray = testing_support::random_image(kWidth, kHeight, 1);
  out[0].colors.rgb = testing_support::random_image(3 * kWidth, kHeight, 2);
  out[1].gray = testing_support::random_image(kWidth, kHeight, 3);
  return out;
}

TEST(ViewMaker, TheFirstStepLeavesTheCornersToTheSecond) {
  const ViewMaker maker = three_cameras();
  View view;
  maker.look(pictures(), &view);
  ASSERT_EQ(view.cameras.size(), 3u);
  EXPECT_FALSE(view.detected());
  for (const CameraView& camera : view.cameras) {
    EXPECT_EQ(camera.features.size(), 0);
    EXPECT_EQ(camera.height, kHeight);
    EXPECT_FALSE(camera.thumbnail->empty());
    EXPECT_EQ(camera.colors == nullptr, &camera == &view.cameras[1]);
  }
  maker.detect(&view);
  EXPECT_TRUE(view.detected());
  for (const CameraView& camera : view.cameras) {
    EXPECT_GT(camera.features.size(), 20);
    EXPECT_EQ(camera.rgb.size(), camera.features.pixels.size());
    EXPECT_EQ(camera.colors, nullptr) << "nobody asks for them again";
  }
}

TEST(ViewMaker, CornersAreTheSameWheneverTheyAreDetected) {
  const ViewMaker maker = three_cameras(), another = three_cameras();
  View late, at_once, between;
  maker.look(pictures(), &late);
  another.look(pictures(), &at_once);
  another.detect(&at_once);
  std::vector<Picture> swapped = pictures();
  std::swap(swapped[0].gray, swapped[1].gray);
  maker.look(std::move(swapped), &between);
  maker.detect(&between);
  maker.detect(&late);
  for (int c = 0; c < 3; ++c) {
    const CameraView &a = late.cameras[c], &b = at_once.cameras[c];
    EXPECT_EQ(a.features.pixels, b.features.pixels);
    EXPECT_EQ(a.features.octaves, b.features.octaves);
    EXPECT_EQ(a.rgb, b.rgb);
    EXPECT_NE(a.features.pixels, between.cameras[c].features.pixels);
  }
}

TEST(ViewMaker, WhatIsDetectedIsLeftAlone) {
  const ViewMaker maker = three_cameras();
  View view;
  maker.look(pictures(), &view);
  maker.detect(&view);
  view.cameras[0].features.pixels[0].setZero();
  maker.detect(&view);
  EXPECT_TRUE(view.cameras[0].features.pixels[0].isZero());
}

}  // namespace
}  // namespace raysfm
