#include "raysfm/views/sight_mask.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "raysfm/features/patches.h"

namespace raysfm {
namespace {

constexpr int kMaskWidth = 333, kMaskHeight = 250;

Camera camera_of(CameraModel model) {
  Camera camera;
  camera.model = std::move(model);
  camera.width = kMaskWidth, camera.height = kMaskHeight;
  return camera;
}

bool has_ray(const Camera& camera, int x, int y) {
  Ray ray;
  return camera.ray({x, y}, &ray);
}

// Each pixel by itself, and all those about it.
bool is_seen_about(const Camera& camera, int x, int y) {
  constexpr int kReach = kPatchRadius + 1;
  for (int v = std::max(y - kReach, 0); v <= std::min(y + kReach, kMaskHeight - 1); ++v) {
    for (int u = std::max(x - kReach, 0); u <= std::min(x + kReach, kMaskWidth - 1); ++u) {
      if (!has_ray(camera, u, v)) return false;
    }
  }
  return true;
}

void expect_mask_of_every_pixel(const Camera& camera) {
  const GrayImage mask = sight_mask(camera, {});
  ASSERT_FALSE(mask.empty());
  int seen = 0;
  for (int y = 0; y < kMaskHeight; ++y) {
    for (int x = 0; x < kMaskWidth; ++x) {
      const bool expected = is_seen_about(camera, x, y);
      ASSERT_EQ(mask.row(y)[x], expected ? 255 : 0) << x << " " << y;
      seen += expected;
    }
  }
  EXPECT_GT(seen, 0);
  EXPECT_LT(seen, kMaskWidth * kMaskHeight);
}

// Looks ahead, a column of the grid every four pixels; one control point is missing.
CentralRayTable table_with_a_hole() {
  RayGridData grid;
  grid.max_x = kMaskWidth - 1, grid.max_y = kMaskHeight - 1;
  grid.grid_width = 86, grid.grid_height = 66;
  for (int i = 0; i < grid.grid_width * grid.grid_height; ++i) {
    const double x = i % grid.grid_width, y = i / grid.grid_width;
    grid.directions.push_back(Eigen::Vector3d(x - 43, y - 33, 50).normalized());
  }
  grid.directions[30 * grid.grid_width + 41].x() = std::numeric_limits<double>::quiet_NaN();
  return CentralRayTable(grid);
}

TEST(SightMask, LeavesOutWhatHasNoRay) {
  for (const double focal : {30.0, 38.7, 41.0}) {
    SCOPED_TRACE(focal);
    expect_mask_of_every_pixel(camera_of(KannalaBrandt{focal, focal, 165.3, 121.1}));
  }
  expect_mask_of_every_pixel(camera_of(
      Mirror::from_parameters({700, 700, 166.5, 124.5, 0.1, 0, 0.083, 0, 0, 0.4, 0, 0, 0, 1, 0.04})));
  expect_mask_of_every_pixel(camera_of(table_with_a_hole()));
}

TEST(SightMask, IsTheGivenOneWhereAllHasRays) {
  const Camera camera = camera_of(Pinhole{300, 300, 166, 124.5});
  EXPECT_TRUE(sight_mask(camera, {}).empty());
  GrayImage given(kMaskWidth, kMaskHeight);
  given.row(7)[9] = 3;
  const GrayImage mask = sight_mask(camera, std::move(given));
  EXPECT_EQ(mask.row(7)[9], 3);
}

}  // namespace
}  // namespace raysfm
