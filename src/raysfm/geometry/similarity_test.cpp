#include "raysfm/geometry/similarity.h"

#include <gtest/gtest.h>

#include "raysfm/core/random.h"
#include "support/random_vectors.h"

namespace raysfm {
namespace {

using testing_support::normal_vector;

Similarity3 random_similarity(Rng& rng) {
  return {std::exp(rng.normal()), exp_so3(normal_vector(rng)), normal_vector(rng)};
}

TEST(Similarity, ComposesAndInverts) {
  Rng rng(5);
  const Similarity3 b_from_a = random_similarity(rng), c_from_b = random_similarity(rng);
  const Eigen::Vector3d x = normal_vector(rng);
  EXPECT_LT(((c_from_b * b_from_a) * x - c_from_b * (b_from_a * x)).norm(), 1e-12);
  EXPECT_LT((inverse(b_from_a) * (b_from_a * x) - x).norm(), 1e-12);
}

// The camera sees the same point in the same direction, farther by the scale.
TEST(Similarity, CarriesPosesFromWorldToWorld) {
  Rng rng(6);
  const Similarity3 b_from_a = random_similarity(rng);
  const Rigid3 cam_from_a{exp_so3(normal_vector(rng)), normal_vector(rng)};
  const Rigid3 cam_from_b = carried_over(cam_from_a, b_from_a);
  const Eigen::Vector3d x = normal_vector(rng);
  EXPECT_LT((cam_from_b * (b_from_a * x) - b_from_a.scale * (cam_from_a * x)).norm(), 1e-12);
}

}  // namespace
}  // namespace raysfm
