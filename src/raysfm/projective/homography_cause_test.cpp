#include "raysfm/projective/homography_cause.h"

#include <gtest/gtest.h>

#include <vector>

#include "raysfm/core/random.h"
#include "raysfm/geometry/rotation.h"
#include "raysfm/lenses/lens.h"

namespace raysfm {
namespace {

Eigen::Matrix3d lens_matrix(double focal, Rng& rng) {
  return Lens{focal, focal, 0.02 * rng.normal(), 0.02 * rng.normal(), 0}.matrix();
}

Eigen::Matrix3d rotation(double angle, Rng& rng) {
  const Eigen::Vector3d axis(rng.normal(), rng.normal(), rng.normal());
  return exp_so3(angle * axis.normalized()).toRotationMatrix();
}

// H = K_b (R + t n^T / d) K_a^-1.
HomographyCause cause(double angle, double translation, bool zooming) {
  Rng rng(3);
  std::vector<Eigen::Matrix3d> homographies;
  for (int i = 0; i < 6; ++i) {
    const double a = zooming ? rng.uniform(1, 3) : 2, b = zooming ? rng.uniform(1, 3) : 2;
    const Eigen::Vector3d normal = Eigen::Vector3d(0.3 * rng.normal(), 0.3 * rng.normal(), 1).normalized();
    const Eigen::Vector3d t = translation * Eigen::Vector3d(rng.normal(), rng.normal(), rng.normal());
    homographies.push_back(lens_matrix(b, rng) * (rotation(angle, rng) + t * normal.transpose()) *
                           lens_matrix(a, rng).inverse());
  }
  return homography_cause(homographies);
}

TEST(HomographyCause, TurningCamerasAreToldFromPlanes) {
  for (const bool zooming : {false, true}) {
    EXPECT_EQ(cause(0.3, 0, zooming), HomographyCause::kRotation);
    EXPECT_EQ(cause(0.3, 0.3, zooming), HomographyCause::kPlane);
    EXPECT_EQ(cause(0, 0.5, zooming), HomographyCause::kPlane);
  }
  EXPECT_EQ(cause(0, 0, false), HomographyCause::kStill);
  EXPECT_EQ(homography_cause({}), HomographyCause::kUnclear);
}

}  // namespace
}  // namespace raysfm
