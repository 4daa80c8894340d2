#include "raysfm/models/ray_table.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "raysfm/camera/camera.h"
#include "raysfm/core/random.h"

namespace raysfm {
namespace {

constexpr double kNoNumber = std::numeric_limits<double>::quiet_NaN();

// A table of random, wide apart directions over the pixels 8..103, 4..67 of an image.
RayGridData random_grid(bool with_points) {
  Rng random(4);
  RayGridData grid;
  grid.min_x = 8, grid.min_y = 4, grid.max_x = 103, grid.max_y = 67;
  grid.grid_width = 9, grid.grid_height = 7;
  for (int i = 0; i < 9 * 7; ++i) {
    grid.directions.push_back(
        Eigen::Vector3d(i % 9 - 4 + 0.3 * random.normal(), i / 9 - 3 + 0.3 * random.normal(), 4)
            .normalized());
    if (with_points) grid.points.push_back({0.1 * random.normal(), 0.1 * random.normal(), 0.01 * (i % 9)});
  }
  return grid;
}

// Cox and de Boor's recursion: basis function of degree k of knot i, knots at the integers.
double basis(int i, int k, double t) {
  if (k == 0) return t >= i && t < i + 1 ? 1 : 0;
  return (t - i) / k * basis(i, k - 1, t) + (i + k + 1 - t) / k * basis(i + 1, k - 1, t);
}

// The spline of a grid at a pixel, control point (i, j) centred at the grid position (i, j).
Eigen::Vector3d spline(const RayGridData& grid, const std::vector<Eigen::Vector3d>& control, double u,
                       double v) {
  const double gx = 1 + (grid.grid_width - 3.0) * (u + 0.5 - grid.min_x) / (grid.max_x + 1 - grid.min_x);
  const double gy = 1 + (grid.grid_height - 3.0) * (v + 0.5 - grid.min_y) / (grid.max_y + 1 - grid.min_y);
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (int j = 0; j < grid.grid_height; ++j) {
    for (int i = 0; i < grid.grid_width; ++i) {
      sum += basis(i - 2, 3, gx) * basis(j - 2, 3, gy) * control[i + j * grid.grid_width];
    }
  }
  return sum;
}

TEST(RayTable, IsTheSplineOfItsControlPoints) {
  const RayGridData grid = random_grid(true);
  const NonCentralRayTable table(grid);
  RayGridData central = grid;
  central.points.clear();
  const CentralRayTable central_table(central);
  int seen = 0;
  for (double v = 0; v < 72; v += 1.7) {
    for (double u = 0; u < 110; u += 1.3) {
      const bool inside = u >= 7.5 && u <= 103.5 && v >= 3.5 && v <= 67.5;
      Ray ray;
      Eigen::Vector3d direction;
      ASSERT_EQ(table.ray({u, v}, &ray), inside) << u << ' ' << v;
      ASSERT_EQ(central_table.unproject({u, v}, &direction), inside);
      if (!inside) continue;
      ++seen;
      EXPECT_LT((ray.direction - spline(grid, grid.directions, u, v).normalized()).norm(), 1e-13);
      EXPECT_LT((ray.origin - spline(grid, grid.points, u, v)).norm(), 1e-13);
      EXPECT_EQ(ray.direction, direction);
    }
  }
  EXPECT_GT(seen, 2000);
}

TEST(RayTable, JacobianAgreesWithDifferences) {
  const NonCentralRayTable table(random_grid(true));
  for (double v = 5; v < 66; v += 3.1) {
    for (double u = 9; u < 102; u += 3.7) {
      Ray ray, plus, minus;
      Eigen::Matrix<double, 6, 2> jacobian;
      ASSERT_TRUE(table.ray({u, v}, &ray, &jacobian));
      for (int c = 0; c < 2; ++c) {
        constexpr double kStep = 1e-4;
        const Eigen::Vector2d step = kStep * Eigen::Vector2d::Unit(c);
        ASSERT_TRUE(table.ray(Eigen::Vector2d(u, v) + step, &plus));
        ASSERT_TRUE(table.ray(Eigen::Vector2d(u, v) - step, &minus));
        EXPECT_LT(((plus.origin - minus.origin) / (2 * kStep) - jacobian.col(c).head<3>()).norm(), 1e-9);
        EXPECT_LT(((plus.direction - minus.direction) / (2 * kStep) - jacobian.col(c).tail<3>()).norm(),
                  1e-9);
      }
    }
  }
}

TEST(RayTable, SeesTheBordersOfItsLastPixels) {
  const NonCentralRayTable table(random_grid(true));
  Ray ray;
  EXPECT_TRUE(table.ray({7.5, 3.5}, &ray));
  EXPECT_TRUE(table.ray({103.5, 67.5}, &ray));
  EXPECT_FALSE(table.ray({7.499, 30}, &ray));
  EXPECT_FALSE(table.ray({103.501, 30}, &ray));
  EXPECT_FALSE(table.ray({50, 3.499}, &ray));
  EXPECT_FALSE(table.ray({50, 67.501}, &ray));
  for (const double bad : {kNoNumber, HUGE_VAL, -HUGE_VAL, 1e300}) {
    EXPECT_FALSE(table.ray({bad, 30}, &ray));
    EXPECT_FALSE(table.ray({50, bad}, &ray));
  }
}

TEST(RayTable, ControlPointsThatAreNoneSeeNothing) {
  RayGridData grid = random_grid(false);
  grid.directions[2 + 3 * 9].setConstant(kNoNumber);
  const CentralRayTable table(grid);
  // The point at the grid position (2, 3) reaches two cells to every side: pixels 8 + 16 (g - 1) - 0.5.
  Eigen::Vector3d direction;
  EXPECT_FALSE(table.unproject({20, 30}, &direction));
  EXPECT_FALSE(table.unproject({8 + 16 * 3 - 0.6, 30}, &direction));
  EXPECT_TRUE(table.unproject({8 + 16 * 3 - 0.4, 30}, &direction));
}

TEST(RayTable, RefusesNumbersThatMakeNone) {
  EXPECT_TRUE(check_ray_grid(random_grid(true)));
  const auto message = [](auto change) {
    RayGridData grid = random_grid(true);
    change(grid);
    const auto result = check_ray_grid(grid);
    Ray ray;
    EXPECT_FALSE(NonCentralRayTable(grid).ray({50, 30}, &ray));
    return result.ok() ? "" : result.error().message.substr(0, result.error().message.find(':'));
  };
  EXPECT_EQ(message([](RayGridData& g) { g.min_x = -2000000; }), "calibration_min_x -2000000");
  EXPECT_EQ(message([](RayGridData& g) { g.max_x = 7; }), "calibration_max_x 7");
  EXPECT_EQ(message([](RayGridData& g) { g.max_y = INT32_MAX; }), "calibration_max_y 2147483647");
  EXPECT_EQ(message([](RayGridData& g) { g.grid_width = 3; }), "grid_width 3");
  EXPECT_EQ(message([](RayGridData& g) { g.grid_height = INT32_MAX; }), "grid_height 2147483647");
  EXPECT_EQ(message([](RayGridData& g) { g.grid_width = g.grid_height = 4000; }), "grid_height 4000");
  EXPECT_EQ(message([](RayGridData& g) { g.directions.pop_back(); }), "directions 62");
  EXPECT_EQ(message([](RayGridData& g) { g.points.pop_back(); }), "points 62");
  EXPECT_EQ(message([](RayGridData& g) { g.points.clear(); }), "");  // a central one
}

TEST(RayTable, CopiesShareTheTable) {
  const CentralRayTable table(random_grid(false));
  const CentralRayTable copy = table;
  EXPECT_EQ(copy.data(), table.data());
  EXPECT_EQ(CentralRayTable().data(), nullptr);
}

}  // namespace
}  // namespace raysfm
