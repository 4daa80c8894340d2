#include "raysfm/geometry/plucker.h"

#include <gtest/gtest.h>

#include "raysfm/core/random.h"
#include "raysfm/geometry/pose.h"
#include "support/random_vectors.h"

namespace raysfm {
namespace {

using testing_support::normal_vector;

using Eigen::Vector3d;

TEST(Plucker, TheMomentIsThatOfEveryPointOfTheLine) {
  Rng rng(1);
  for (int i = 0; i < 100; ++i) {
    const Ray ray{normal_vector(rng), normal_vector(rng).normalized()};
    const PluckerLine line = plucker_line(ray);
    const Vector3d point = ray.origin + rng.uniform(-5, 5) * ray.direction;
    EXPECT_LT((line.direction.cross(point) - line.moment).norm(), 1e-14 * (1 + point.norm()));
    EXPECT_NEAR(line.direction.dot(line.moment), 0, 1e-14);
    // LBA09 4.1: q' x q + alpha q runs along the line.
    const Vector3d nearest = line.moment.cross(line.direction);
    EXPECT_LT((nearest - ray.origin).cross(ray.direction).norm(), 1e-13);
  }
}

TEST(Plucker, ThePlessEquationHoldsWhereTheLinesMeetAndMeasuresTheirDistance) {
  Rng rng(2);
  for (int i = 0; i < 100; ++i) {
    const Rigid3 rig0_from_rig1{exp_so3(normal_vector(rng)), normal_vector(rng)};
    const Vector3d point = 3 * normal_vector(rng);
    const Ray ray0{normal_vector(rng), Vector3d()}, ray1{normal_vector(rng), Vector3d()};
    const PluckerLine line0 = plucker_line({ray0.origin, (point - ray0.origin).normalized()});
    const Vector3d in_rig1 = rig0_from_rig1.inverse() * point;
    const Vector3d direction1 = (in_rig1 - ray1.origin).normalized();
    const auto residual = [&](const Vector3d& origin1) {
      return pless_residual(rig0_from_rig1.rotation.toRotationMatrix(), rig0_from_rig1.translation, line0,
                            plucker_line({origin1, direction1}));
    };
    EXPECT_NEAR(residual(ray1.origin), 0, 1e-12);
    // The second line moved off the first by 0.1 along their common normal.
    const Vector3d normal = line0.direction.cross(rig0_from_rig1.rotation * direction1);
    const Vector3d off = rig0_from_rig1.rotation.conjugate() * (0.1 * normal.normalized());
    EXPECT_NEAR(std::abs(residual(ray1.origin + off)), 0.1 * normal.norm(), 1e-12);
  }
}

}  // namespace
}  // namespace raysfm
