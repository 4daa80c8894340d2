#include "raysfm/mesh/tetrahedra.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "raysfm/core/random.h"

namespace raysfm {
namespace {

using Points = std::vector<Eigen::Vector3d>;

const Eigen::AlignedBox3d kBox(Eigen::Vector3d::Constant(-1), Eigen::Vector3d(1, 1.5, 1));

double volume(const Tetrahedra& t, const Tetrahedron& cell) {
  const Eigen::Vector3d a = t.position(cell.vertices[0]);
  return std::abs((t.position(cell.vertices[1]) - a)
                      .dot((t.position(cell.vertices[2]) - a).cross(t.position(cell.vertices[3]) - a))) /
         6;
}

// What makes them tetrahedra of a box: neighbours know each other and share three vertices, and the volumes
// add up to that of the box.
void expect_sound(const Tetrahedra& t) {
  double sum = 0;
  for (size_t c = 0; c < t.cells().size(); ++c) {
    const Tetrahedron& cell = t.cells()[c];
    if (cell.vertices[0] < 0) continue;
    sum += volume(t, cell);
    for (int k = 0; k < 4; ++k) {
      if (cell.neighbours[k] < 0) continue;
      const Tetrahedron& next = t.cells()[cell.neighbours[k]];
      std::set<int> shared(cell.vertices.begin(), cell.vertices.end());
      EXPECT_EQ(shared.count(cell.vertices[k]), 1u);
      shared.erase(cell.vertices[k]);
      int common = 0, back = 0;
      for (int j = 0; j < 4; ++j) {
        common += static_cast<int>(shared.count(next.vertices[j]));
        back += next.neighbours[j] == static_cast<int>(c);
      }
      EXPECT_EQ(common, 3);
      EXPECT_EQ(back, 1);
    }
  }
  EXPECT_NEAR(sum, kBox.volume(), 1e-5);
}

// No point lies in the sphere about any tetrahedron: all points against all, by its centre and radius.
void expect_delaunay(const Tetrahedra& t) {
  for (const Tetrahedron& cell : t.cells()) {
    if (cell.vertices[0] < 0) continue;
    const Eigen::Vector3d origin = t.position(cell.vertices[0]);
    Eigen::Matrix3d rows;
    Eigen::Vector3d half;
    for (int k = 0; k < 3; ++k) {
      rows.row(k) = t.position(cell.vertices[k + 1]) - origin;
      half[k] = rows.row(k).squaredNorm() / 2;
    }
    const Eigen::Vector3d centre = rows.fullPivLu().solve(half);
    const double radius = centre.norm();
    for (int v = 0; v < t.vertex_count(); ++v) {
      EXPECT_GT((t.position(v) - origin - centre).norm(), radius * (1 - 1e-6));
    }
  }
}

TEST(Tetrahedra, RandomPointsAreDelaunay) {
  Rng rng(1);
  Tetrahedra t(kBox);
  for (int i = 0; i < 300; ++i) {
    EXPECT_EQ(t.add({rng.uniform(-0.9, 0.9), rng.uniform(-0.9, 1.4), rng.uniform(-0.9, 0.9)}),
              i + Tetrahedra::kCorners);
  }
  expect_sound(t);
  expect_delaunay(t);
}

// A grid is the worst there is: everything is cospherical and coplanar.
TEST(Tetrahedra, Lattice) {
  Tetrahedra t(kBox);
  std::set<int> vertices;
  for (int i = 0; i < 9 * 9 * 9; ++i) {
    const Eigen::Vector3d point((i % 9 - 4) / 5.0, (i / 9 % 9 - 4) / 5.0, (i / 81 - 4) / 5.0);
    const int vertex = t.add(point);
    ASSERT_GE(vertex, Tetrahedra::kCorners);
    vertices.insert(vertex);
    EXPECT_LT((t.position(vertex) - point).norm(), 1e-5);
    EXPECT_EQ(t.add(t.position(vertex)), vertex);
  }
  EXPECT_EQ(vertices.size(), 729u);
  expect_sound(t);
}

TEST(Tetrahedra, LocatesByBarycentricCoordinates) {
  Rng rng(2);
  Tetrahedra t(kBox);
  const auto random = [&] {
    return Eigen::Vector3d(rng.uniform(-0.9, 0.9), rng.uniform(-0.9, 1.4), rng.uniform(-0.9, 0.9));
  };
  for (int i = 0; i < 2000; ++i) t.add(random());
  for (int i = 0; i < 500; ++i) {
    const Eigen::Vector3d point = random();
    const Tetrahedron& cell = t.cells()[t.locate(point)];
    Eigen::Matrix4d corners;
    for (int k = 0; k < 4; ++k) corners.col(k) = t.position(cell.vertices[k]).homogeneous();
    EXPECT_GT(corners.fullPivLu().solve(point.homogeneous()).minCoeff(), -1e-3);
  }
}

TEST(Tetrahedra, ContainsWhatLiesInTheBox) {
  const Tetrahedra t(kBox);
  EXPECT_TRUE(t.contains({0, 1.49, 0}));
  EXPECT_FALSE(t.contains({0, 1.51, 0}));
  EXPECT_FALSE(t.contains({0, 0, -1.01}));
  EXPECT_FALSE(t.contains({NAN, 0, 0}));
  EXPECT_FALSE(t.contains({0, INFINITY, 0}));
}

// Signs that doubles cannot tell: a volume and a power of one, of coordinates near the end of the grid.
TEST(GridPredicates, AreExact) {
  const int32_t n = kGridSide - 1;
  const GridPoint a = {0, 0, 0}, b = {n, n - 1, n}, c = {n - 1, n - 2, n - 1};
  // c lies beside the line from a to b by less than a step; d in its plane with another point.
  const GridPoint on = {0, 0, 1};
  EXPECT_EQ(orientation(a, b, c, a), 0);
  EXPECT_NE(orientation(a, b, c, on), 0);
  EXPECT_EQ(orientation(a, b, c, on), -orientation(b, a, c, on));
  // Cube corners are cospherical.
  const GridPoint x = {n, 0, 0}, y = {0, n, 0}, z = {0, 0, n}, far = {n, n, n};
  const int sign = orientation(a, x, y, z);
  const auto inside = [&](const GridPoint& e) {
    return sign > 0 ? in_sphere(a, x, y, z, e) : in_sphere(x, a, y, z, e);
  };
  EXPECT_EQ(inside(far), 0);
  EXPECT_EQ(inside({n, n, n - 1}), 1);
  EXPECT_EQ(inside({n, n - 1, n}), 1);
  EXPECT_EQ(inside({n / 2, n / 2, n / 2}), 1);
}

}  // namespace
}  // namespace raysfm
