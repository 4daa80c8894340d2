#include "raysfm/places/pose_graph.h"

#include <gtest/gtest.h>

#include <limits>

#include "support/ceres_graph.h"
#include "support/drifted_loop.h"

namespace raysfm {
namespace {

using test::all_but_first;
using test::center_error;
using test::drifted_loop;
using test::DriftedLoop;

bool same_bits(const Similarity3& a, const Similarity3& b) {
  return a.scale == b.scale && a.rotation.coeffs() == b.rotation.coeffs() && a.translation == b.translation;
}

LmSummary adjust(DriftedLoop& loop, const GraphOptions& options = {}) {
  return adjust_graph(loop.nodes, all_but_first(loop.nodes.size()), loop.edges, options);
}

TEST(PoseGraph, FindsTheMinimumThatCeresFinds) {
  for (const bool scale_is_known : {false, true}) {
    DriftedLoop loop = drifted_loop({.nodes = 150, .noise = 3e-3, .scale_is_known = scale_is_known});
    const ceres::Solver::Summary theirs =
        test::adjust_graph_with_ceres(loop.nodes, loop.edges, scale_is_known, 1e-12);
    const LmSummary ours = adjust(loop, {.scale_is_known = scale_is_known, .min_relative_decrease = 1e-10});
    EXPECT_EQ(ours.termination, Termination::kConverged);
    EXPECT_LE(ours.iterations, 12);
    EXPECT_NEAR(ours.initial_cost, theirs.initial_cost, 1e-9 * theirs.initial_cost);
    EXPECT_NEAR(ours.final_cost, theirs.final_cost, 1e-6 * theirs.final_cost);
    EXPECT_GT(theirs.final_cost, 10);
  }
}

// Every relation is right, and the nodes are not.
TEST(PoseGraph, RecoversALoopWithoutNoise) {
  DriftedLoop loop = drifted_loop(
      {.nodes = 200, .scale_drift = 1, .rotation_drift_deg = 0, .noise = 0, .noise_translation = 0});
  Rng rng(4);
  for (size_t i = 1; i < loop.nodes.size(); ++i) {
    const Similarity3 off{std::exp(0.3 * rng.normal()), exp_so3(0.3 * test::normal_vector(rng)),
                          3 * test::normal_vector(rng)};
    loop.nodes[i] = off * loop.truth[i];
  }
  EXPECT_GT(center_error(loop), 1);
  const LmSummary summary = adjust(loop);
  EXPECT_EQ(summary.termination, Termination::kConverged);
  EXPECT_LE(summary.iterations, 15);
  for (size_t i = 0; i < loop.nodes.size(); ++i) {
    EXPECT_LT((loop.nodes[i].translation - loop.truth[i].translation).norm(), 1e-8);
    EXPECT_LT(rotation_angle(loop.nodes[i].rotation * loop.truth[i].rotation.conjugate()), 1e-8);
    EXPECT_NEAR(loop.nodes[i].scale, 1, 1e-9);
  }
}

TEST(PoseGraph, ClosesALoopWhoseScaleHasDrifted) {
  DriftedLoop loop = drifted_loop({.nodes = 1000, .scale_drift = 2, .rotation_drift_deg = 5});
  const double before = center_error(loop);
  EXPECT_GT(before, 50);
  const LmSummary summary = adjust(loop);
  EXPECT_LT(center_error(loop), 0.1 * before);
  EXPECT_LE(summary.iterations, 8);
  EXPECT_EQ(summary.termination, Termination::kConverged);
}

// The ends meet, however far they were apart.
TEST(PoseGraph, ClosesALoopThatHasTurned) {
  for (const double scale : {0.5, 4.0}) {
    for (const double degrees : {30.0, 150.0}) {
      DriftedLoop loop = drifted_loop({.nodes = 1000, .scale_drift = scale, .rotation_drift_deg = degrees});
      const LmSummary summary = adjust(loop);
      EXPECT_LE(summary.iterations, 10);
      const Similarity3 first_from_last = loop.nodes.front() * inverse(loop.nodes.back());
      const Similarity3 expected = loop.truth.front() * inverse(loop.truth.back());
      EXPECT_LT((first_from_last.translation - expected.translation).norm(), 0.5);
      EXPECT_LT(rotation_angle(first_from_last.rotation * expected.rotation.conjugate()), 0.05);
      EXPECT_NEAR(first_from_last.scale, expected.scale, 0.05);
    }
  }
}

TEST(PoseGraph, HoldsScalesThatAreKnown) {
  DriftedLoop loop = drifted_loop({.nodes = 200, .scale_drift = 2});
  for (size_t i = 0; i < loop.nodes.size(); ++i) loop.nodes[i].scale = 1 + 0.001 * static_cast<double>(i);
  const DriftedLoop before = loop;
  adjust(loop, {.scale_is_known = true});
  for (size_t i = 1; i < loop.nodes.size(); ++i) {
    EXPECT_EQ(loop.nodes[i].scale, before.nodes[i].scale);
    EXPECT_NE(loop.nodes[i].translation, before.nodes[i].translation);
  }
}

TEST(PoseGraph, LeavesHeldAndUnconnectedNodesAsTheyAre) {
  DriftedLoop loop = drifted_loop({.nodes = 100});
  Rng rng(5);
  const Similarity3 alone{3, exp_so3(test::normal_vector(rng)), test::normal_vector(rng)};
  loop.nodes.push_back(alone);
  const DriftedLoop before = loop;
  std::vector<uint8_t> is_free(loop.nodes.size(), 1);
  is_free[0] = is_free[40] = 0;
  adjust_graph(loop.nodes, is_free, loop.edges);
  for (size_t i : {0, 40, 100}) EXPECT_TRUE(same_bits(loop.nodes[i], before.nodes[i])) << i;
  for (size_t i : {1, 39, 99}) EXPECT_FALSE(same_bits(loop.nodes[i], before.nodes[i])) << i;
}

// Two loops that nothing joins, and nothing is held.
TEST(PoseGraph, HoldsTheFirstNodeOfAPartThatHangsInTheAir) {
  DriftedLoop one = drifted_loop({.nodes = 50}), both = one;
  for (GraphEdge edge : one.edges) {
    edge.a += 50, edge.b += 50;
    both.edges.push_back(edge);
  }
  both.nodes.insert(both.nodes.end(), one.nodes.begin(), one.nodes.end());
  const LmSummary summary = adjust_graph(both.nodes, std::vector<uint8_t>(100, 1), both.edges);
  EXPECT_EQ(summary.termination, Termination::kConverged);
  EXPECT_TRUE(same_bits(both.nodes[50], one.nodes[0]));
  adjust(one);
  for (int i : {1, 25, 49}) {
    EXPECT_LT((both.nodes[i].translation - one.nodes[i].translation).norm(), 1e-5);
    EXPECT_LT((both.nodes[50 + i].translation - one.nodes[i].translation).norm(), 1e-5);
  }
}

TEST(PoseGraph, TakesEdgesThatDoNotMeasureTheScale) {
  DriftedLoop loop = drifted_loop({.nodes = 100, .scale_drift = 1.5});
  for (GraphEdge& edge : loop.edges) edge.sigma_log_scale = std::numeric_limits<double>::infinity();
  const double before = center_error(loop);
  const LmSummary summary = adjust(loop);
  EXPECT_EQ(summary.termination, Termination::kConverged);
  EXPECT_LT(summary.final_cost, 1e-2 * summary.initial_cost);
  EXPECT_LT(center_error(loop), before);
}

TEST(PoseGraph, RefusesWhatContradictsItself) {
  const DriftedLoop good = drifted_loop({.nodes = 20});
  const auto refused = [&](const auto& spoil) {
    DriftedLoop loop = good;
    std::vector<uint8_t> is_free = all_but_first(loop.nodes.size());
    spoil(loop, is_free);
    const DriftedLoop before = loop;
    const LmSummary summary = adjust_graph(loop.nodes, is_free, loop.edges);
    return summary.termination == Termination::kInvalidProblem && same_bits(before.nodes[5], loop.nodes[5]);
  };
  using Flags = std::vector<uint8_t>;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(refused([](DriftedLoop&, Flags&) {}));
  EXPECT_TRUE(refused([](DriftedLoop&, Flags& is_free) { is_free.pop_back(); }));
  EXPECT_TRUE(refused([](DriftedLoop& loop, Flags&) { loop.edges[3].a = -1; }));
  EXPECT_TRUE(refused([](DriftedLoop& loop, Flags&) { loop.edges[3].b = 20; }));
  EXPECT_TRUE(refused([](DriftedLoop& loop, Flags&) { loop.edges[3].b = loop.edges[3].a; }));
  EXPECT_TRUE(refused([](DriftedLoop& loop, Flags&) { loop.edges[3].sigma_rotation = 0; }));
  EXPECT_TRUE(refused([&](DriftedLoop& loop, Flags&) { loop.edges[3].sigma_translation = nan; }));
  EXPECT_TRUE(refused([&](DriftedLoop& loop, Flags&) { loop.edges[3].b_from_a.translation.y() = nan; }));
  EXPECT_TRUE(refused([](DriftedLoop& loop, Flags&) { loop.edges[3].b_from_a.scale = -1; }));
  EXPECT_TRUE(refused([](DriftedLoop& loop, Flags&) { loop.nodes[3].rotation.coeffs().setZero(); }));
  EXPECT_TRUE(refused([&](DriftedLoop& loop, Flags&) { loop.nodes[3].scale = nan; }));
}

TEST(PoseGraph, HasNothingToDoWithoutEdges) {
  std::vector<Similarity3> nodes(3);
  EXPECT_EQ(adjust_graph(nodes, std::vector<uint8_t>(3, 1), {}).termination, Termination::kNothingToDo);
  EXPECT_EQ(adjust_graph({}, {}, {}).termination, Termination::kNothingToDo);
}

}  // namespace
}  // namespace raysfm
