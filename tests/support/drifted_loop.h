#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include "raysfm/core/random.h"
#include "raysfm/geometry/similarity.h"
#include "raysfm/places/graph_edge.h"
#include "support/random_vectors.h"

namespace raysfm::test {

using testing_support::normal_vector;

// A camera that comes back to where it began, as an odometry that drifts would tell it.
struct DriftedLoop {
  std::vector<Similarity3> truth;  // node_from_world
  std::vector<Similarity3> nodes;  // chained from edges between neighbours; the first is right
  std::vector<GraphEdge> edges;    // of each node with the next `reach`, then those that close the loop
};

struct LoopSettings {
  int nodes = 1000, reach = 3, loop_edges = 5;
  double scale_drift = 2, rotation_drift_deg = 30;  // from the first node to the last
  double noise = 1e-3;                              // radians and logarithm of the scale, per edge
  double noise_translation = 1e-2;
  bool scale_is_known = false;
};

// A wavy circle, one unit from node to node, looking ahead.
inline Similarity3 node_on_loop(int i, int nodes) {
  const double angle = 2 * std::numbers::pi * i / nodes, radius = nodes / (2 * std::numbers::pi);
  const Eigen::Vector3d center(radius * std::cos(angle), radius * std::sin(angle),
                               0.05 * radius * std::sin(3 * angle));
  const Eigen::Quaterniond node_from_world =
      exp_so3({0.1 * std::sin(5 * angle), 0.1 * std::cos(2 * angle), 0}) * exp_so3({0, 0, -angle});
  return {1.0, node_from_world, -(node_from_world * center)};
}

inline DriftedLoop drifted_loop(const LoopSettings& settings, uint64_t seed = 1) {
  Rng rng(seed);
  const double s = settings.scale_is_known ? 0 : 1, per_node = 1.0 / settings.nodes;
  const Similarity3 drift{
      std::exp(s * std::log(settings.scale_drift) * per_node),
      exp_so3(settings.rotation_drift_deg * std::numbers::pi / 180 * per_node * Eigen::Vector3d(0.6, 0, 0.8)),
      Eigen::Vector3d::Zero()};
  const auto noisy = [&](const Similarity3& exact) {
    return Similarity3{exact.scale * std::exp(s * settings.noise * rng.normal()),
                       exp_so3(settings.noise * normal_vector(rng)) * exact.rotation,
                       exact.translation + settings.noise_translation * normal_vector(rng)};
  };
  const auto edge = [&](int a, int b, const Similarity3& b_from_a) {
    return GraphEdge{a,
                     b,
                     noisy(b_from_a),
                     std::max(settings.noise_translation, 1e-3),
                     std::max(settings.noise, 1e-3),
                     std::max(settings.noise, 1e-3)};
  };
  DriftedLoop loop;
  for (int i = 0; i < settings.nodes; ++i) loop.truth.push_back(node_on_loop(i, settings.nodes));
  loop.nodes = loop.truth;
  for (int i = 0; i + 1 < settings.nodes; ++i) {
    loop.edges.push_back(edge(i, i + 1, drift * loop.truth[i + 1] * inverse(loop.truth[i])));
    loop.nodes[i + 1] = loop.edges.back().b_from_a * loop.nodes[i];
  }
  for (int reach = 2; reach <= settings.reach; ++reach) {
    for (int i = 0; i + reach < settings.nodes; ++i) {
      loop.edges.push_back(edge(i, i + reach, loop.nodes[i + reach] * inverse(loop.nodes[i])));
    }
  }
  for (int k = 0; k < settings.loop_edges; ++k) {
    const int a = settings.nodes - 1 - k;
    loop.edges.push_back(edge(a, k, loop.truth[k] * inverse(loop.truth[a])));
  }
  return loop;
}

// Root of the mean square distance of the nodes' centres from where they are.
inline double center_error(const DriftedLoop& loop) {
  double sum = 0;
  for (size_t i = 0; i < loop.nodes.size(); ++i) {
    sum += (graph_node(loop.nodes[i]).center - graph_node(loop.truth[i]).center).squaredNorm();
  }
  return std::sqrt(sum / static_cast<double>(loop.nodes.size()));
}

// All free but the first.
inline std::vector<uint8_t> all_but_first(size_t nodes) {
  std::vector<uint8_t> is_free(nodes, 1);
  is_free[0] = 0;
  return is_free;
}

}  // namespace raysfm::test
