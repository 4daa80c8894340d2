#include "raysfm/camera/stretch.h"

#include <gtest/gtest.h>

#include "support/model_fixtures.h"

namespace raysfm {
namespace {

template <typename Model>
void expect_same_rays(const Eigen::Vector2d& factors) {
  for (const Model& model : testing_support::fixtures<Model>()) {
    Camera camera;
    camera.model = model;
    camera.width = 640, camera.height = 480;
    Camera wide = camera;
    ASSERT_TRUE(stretch(factors, &wide));
    for (double v = 100; v < 400; v += 50) {
      for (double u = 150; u < 500; u += 50) {
        Ray before, after;
        const Eigen::Vector2d pixel(u, v), half(0.5, 0.5);
        ASSERT_EQ(camera.ray(pixel, &before), wide.ray((pixel + half).cwiseProduct(factors) - half, &after));
        EXPECT_LT((before.direction - after.direction).norm(), 1e-9);
      }
    }
  }
}

TEST(Stretch, EveryPointSeesWhatItSaw) {
  for (const auto& factors : {Eigen::Vector2d(0.75, 1), {1, 1}, {1.4, 1}, {0.5, 0.5}, {2, 3}}) {
    expect_same_rays<Pinhole>(factors);
    expect_same_rays<Radtan>(factors);
    expect_same_rays<KannalaBrandt>(factors);
  }
}

TEST(Stretch, IsRefusedWithoutFocalLengths) {
  Camera camera;
  camera.model = testing_support::fixtures<OCam>()[0];
  EXPECT_FALSE(stretch({1.4, 1}, &camera));
}

}  // namespace
}  // namespace raysfm
