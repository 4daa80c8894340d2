#include "raysfm/camera/stretch.h"

#include <gtest/gtest.h>

#include "support/model_fixtures.h"

namespace raysfm {
namespace {

template <typename Model>
void expect_same_rays(double factor) {
  for (const Model& model : testing_support::fixtures<Model>()) {
    Camera camera;
    camera.model = model;
    camera.width = 640, camera.height = 480;
    Camera wide = camera;
    ASSERT_TRUE(stretch(factor, &wide));
    for (double v = 100; v < 400; v += 50) {
      for (double u = 150; u < 500; u += 50) {
        Ray before, after;
        ASSERT_EQ(camera.ray({u, v}, &before), wide.ray({(u + 0.5) * factor - 0.5, v}, &after));
        EXPECT_LT((before.direction - after.direction).norm(), 1e-9);
      }
    }
  }
}

TEST(Stretch, EveryPointSeesWhatItSaw) {
  for (const double factor : {0.75, 1.0, 1.4}) {
    expect_same_rays<Pinhole>(factor);
    expect_same_rays<Radtan>(factor);
    expect_same_rays<KannalaBrandt>(factor);
  }
}

TEST(Stretch, IsRefusedWithoutAFocalLengthInX) {
  Camera camera;
  camera.model = testing_support::fixtures<OCam>()[0];
  EXPECT_FALSE(stretch(1.4, &camera));
}

}  // namespace
}  // namespace raysfm
