#include "raysfm/views/view_maker.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <memory>
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

// The left quarter of the picture has most of the contrast.
TEST(ViewMaker, EvenCornersLeaveLessToAPartWithAllTheContrast) {
  constexpr int kQuarter = kWidth / 4;
  const ViewMaker maker({{0, {}, {.max_features = 60}}});
  std::vector<Picture> picture(1);
  picture[0].gray = testing_support::random_image(kWidth, kHeight, 1);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = kQuarter; x < kWidth; ++x) {
      uint8_t& grey = picture[0].gray.row(y)[x];
      grey = static_cast<uint8_t>(110 + grey / 8);
    }
  }
  picture[0].colors.rgb = testing_support::random_image(3 * kWidth, kHeight, 2);
  auto looked = std::make_shared<View>();
  maker.look(std::move(picture), looked.get());
  const auto strong = [&](const View& view) {
    const auto& pixels = view.cameras[0].features.pixels;
    return static_cast<double>(
               std::ranges::count_if(pixels, [](const auto& p) { return p.x() < kQuarter; })) /
           static_cast<double>(pixels.size());
  };
  const ViewPtr strongest = maker.detected(looked), even = maker.detected_evenly(looked);
  EXPECT_GT(strong(*strongest), 0.6);
  EXPECT_LT(strong(*even), 0.5);
  EXPECT_FALSE(strongest->evenly);
  EXPECT_TRUE(even->evenly);
  EXPECT_EQ(maker.detected_evenly(even), even);
  // The same whether the strongest were detected before, with their colours.
  const ViewPtr again = maker.detected_evenly(strongest);
  EXPECT_EQ(again->cameras[0].features.pixels, even->cameras[0].features.pixels);
  EXPECT_EQ(again->cameras[0].rgb, even->cameras[0].rgb);
  for (int i = 0; i < even->cameras[0].features.size(); ++i) {
    const auto& pixels = strongest->cameras[0].features.pixels;
    const auto same = std::ranges::find(pixels, even->cameras[0].features.pixels[i]);
    if (same == pixels.end()) continue;
    EXPECT_EQ(even->cameras[0].rgb[i], strongest->cameras[0].rgb[same - pixels.begin()]);
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

// Random numbers depend on it, which must be the same whether corners were detected ahead of time or not.
TEST(ViewMaker, WhatIsMadeOfAViewIsOfTheSameFrame) {
  const ViewMaker maker = three_cameras();
  View seen;
  seen.frame = 7, seen.timestamp = 0.7, seen.name = "seventh", seen.repeats = 3;
  maker.look(pictures(), &seen);
  seen.detect_ms = 4;
  const ViewPtr view = std::make_shared<View>(std::move(seen)), with_corners = maker.detected(view);
  EXPECT_TRUE(with_corners->detected());
  EXPECT_GT(with_corners->detect_ms, 4);
  for (const ViewPtr& made : {with_corners, images_of(*view), coarser_images_of(*view, 1)}) {
    EXPECT_EQ(made->frame, 7);
    EXPECT_EQ(made->timestamp, 0.7);
    EXPECT_EQ(made->name, "seventh");
    EXPECT_EQ(made->repeats, 3);
    EXPECT_EQ(made->random_stream(), 4u);
  }
}

// Features of a key frame: some anywhere, then two of three corners of each camera, whose patches are those
// of the view.
TEST(KeyFrameView, CornersKeepTheirPatches) {
  View seen;
  const ViewMaker maker = three_cameras();
  maker.look(pictures(), &seen);
  maker.detect(&seen);
  constexpr float kMarked = 42;
  seen.cameras[1].patches.set_inverse_norm(4, kMarked);
  Rig cameras;
  MapKeyFrame keyframe;
  for (uint8_t c = 0; c < 3; ++c) {
    Camera& camera = cameras.cameras.emplace_back();
    camera.width = seen.cameras[c].width, camera.height = kHeight;
    camera.model = Radtan::from_parameters({100, 100, 0.5 * camera.width, 48, 0, 0, 0, 0, 0});
    for (int i = 0; i < 5; ++i) keyframe.add(c, {30.3f + static_cast<float>(i), 40.6f}, 0, -1);
  }
  const int first_corner = keyframe.size();
  int marked = -1;
  for (uint8_t c = 0; c < 3; ++c) {
    const Features& corners = seen.cameras[c].features;
    for (int i = 0; i < corners.size(); ++i) {
      if (c == 1 && i == 4) marked = keyframe.size();
      if (i % 3 != 2) keyframe.add(c, corners.pixels[i], corners.octaves[i], -1);
    }
  }
  const TrackingRig rig(cameras, ErrorMeasure::kPixel);
  const ViewPtr view = std::make_shared<View>(std::move(seen));
  const KeyFrameView known = make_keyframe_view(view, keyframe, rig, first_corner),
                     anew = make_keyframe_view(view, keyframe, rig);
  ASSERT_EQ(known.patches.size(), keyframe.size());
  for (int f = 0; f < keyframe.size(); ++f) {
    if (anew.patches.valid(f)) {
      EXPECT_EQ(std::memcmp(known.patches.patch(f), anew.patches.patch(f), kPatchArea), 0) << f;
    }
    if (f != marked) {
      EXPECT_EQ(known.patches.inverse_norm(f), anew.patches.inverse_norm(f)) << f;
    }
  }
  EXPECT_EQ(known.patches.inverse_norm(marked), kMarked) << "taken from the view";
}

}  // namespace
}  // namespace raysfm
