#include "raysfm/places/graph_edge.h"

#include <gtest/gtest.h>

#include "raysfm/core/random.h"
#include "raysfm/geometry/similarity.h"
#include "support/random_vectors.h"

namespace raysfm {
namespace {

using testing_support::normal_vector;

Similarity3 random_transform(Rng& rng) {
  return {std::exp(rng.normal()), exp_so3(normal_vector(rng)), normal_vector(rng)};
}

TEST(GraphEdge, NodesAreSimilarities) {
  Rng rng(1);
  const Similarity3 node_from_world = random_transform(rng);
  const Eigen::Vector3d x = normal_vector(rng);
  EXPECT_LT((similarity_of(graph_node(node_from_world)) * x - node_from_world * x).norm(), 1e-13);
  EXPECT_LT((node_from_world * graph_node(node_from_world).center).norm(), 1e-13);
}

TEST(GraphEdge, ResidualIsWhatIsPredictedLessWhatIsMeasured) {
  Rng rng(2);
  const Similarity3 a = random_transform(rng), b = random_transform(rng), predicted = b * inverse(a);
  GraphEdge edge{0, 1, predicted, 0.5, 0.25, 0.125};
  EXPECT_LT(edge_residual(graph_node(a), graph_node(b), edge).norm(), 1e-12);
  const Eigen::Vector3d t(1, 2, 3), w(0.1, -0.2, 0.3);
  edge.b_from_a.translation -= t;
  edge.b_from_a.rotation = exp_so3(-w) * predicted.rotation;
  edge.b_from_a.scale = predicted.scale / 2;
  EdgeResidual expected;
  expected << 2 * t, 4 * w, 8 * std::log(2.0);
  EXPECT_LT((edge_residual(graph_node(a), graph_node(b), edge) - expected).norm(), 1e-12);
}

// Central differences, from rotations that agree to some that are half a turn apart.
TEST(GraphEdge, DerivativesAreThoseOfTheResidual) {
  for (const double angle : {0.0, 1e-6, 0.0099, 0.0101, 1.0, 3.0}) {
    Rng rng(3);
    const GraphNode a = graph_node(random_transform(rng)), b = graph_node(random_transform(rng));
    GraphEdge edge{0, 1, similarity_of(b) * inverse(similarity_of(a)), 0.7, 0.3, 0.2};
    edge.b_from_a.rotation = exp_so3(angle * normal_vector(rng).normalized()) * edge.b_from_a.rotation;
    EdgeJacobian by_a, by_b;
    EXPECT_EQ(edge_residual(a, b, edge, &by_a, &by_b), edge_residual(a, b, edge));
    for (int k = 0; k < 7; ++k) {
      constexpr double kStep = 1e-5;
      const GraphTangent delta = kStep * GraphTangent::Unit(k);
      const EdgeResidual numeric_a =
          (edge_residual(retract(a, delta), b, edge) - edge_residual(retract(a, -delta), b, edge)) /
          (2 * kStep);
      const EdgeResidual numeric_b =
          (edge_residual(a, retract(b, delta), edge) - edge_residual(a, retract(b, -delta), edge)) /
          (2 * kStep);
      EXPECT_LT((by_a.col(k) - numeric_a).norm(), 1e-7) << "angle " << angle << " number " << k;
      EXPECT_LT((by_b.col(k) - numeric_b).norm(), 1e-7) << "angle " << angle << " number " << k;
    }
  }
}

}  // namespace
}  // namespace raysfm
