#pragma once

#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include <array>
#include <cmath>
#include <span>
#include <vector>

#include "raysfm/places/graph_edge.h"

namespace raysfm::test {

// The residual of an edge from its definition, with the derivatives that Ceres takes. Nodes are the centre,
// the quaternion x, y, z, w, and the logarithm of the scale.
struct CeresEdge {
  const GraphEdge& edge;

  template <typename T>
  bool operator()(const T* center_a, const T* q_a, const T* l_a, const T* center_b, const T* q_b,
                  const T* l_b, T* r) const {
    using Vector = Eigen::Matrix<T, 3, 1>;
    using Quaternion = Eigen::Quaternion<T>;
    const Quaternion a(q_a[3], q_a[0], q_a[1], q_a[2]), b(q_b[3], q_b[0], q_b[1], q_b[2]);
    const Vector apart(center_a[0] - center_b[0], center_a[1] - center_b[1], center_a[2] - center_b[2]);
    const Vector t = exp(l_b[0]) * (b * apart) - edge.b_from_a.translation.template cast<T>();
    const Quaternion turn = b * a.conjugate() * edge.b_from_a.rotation.conjugate().template cast<T>();
    const T q[4] = {turn.w(), turn.x(), turn.y(), turn.z()};
    ceres::QuaternionToAngleAxis(q, r + 3);
    for (int k = 0; k < 3; ++k) r[k] = t[k] / edge.sigma_translation;
    for (int k = 3; k < 6; ++k) r[k] /= edge.sigma_rotation;
    r[6] = (l_b[0] - l_a[0] - std::log(edge.b_from_a.scale)) / edge.sigma_log_scale;
    return true;
  }
};

// The least cost that Ceres finds from these nodes, the first of which is held.
inline ceres::Solver::Summary adjust_graph_with_ceres(std::span<const Similarity3> node_from_world,
                                                      std::span<const GraphEdge> edges, bool scale_is_known,
                                                      double function_tolerance) {
  struct Node {
    std::array<double, 3> center;
    std::array<double, 4> rotation;
    double log_scale;
  };
  std::vector<Node> nodes;
  for (const Similarity3& s : node_from_world) {
    const Eigen::Vector3d c = -(s.rotation.conjugate() * s.translation) / s.scale;
    nodes.push_back({{c.x(), c.y(), c.z()},
                     {s.rotation.x(), s.rotation.y(), s.rotation.z(), s.rotation.w()},
                     std::log(s.scale)});
  }
  ceres::Problem problem;
  for (const GraphEdge& edge : edges) {
    Node &a = nodes[edge.a], &b = nodes[edge.b];
    problem.AddResidualBlock(
        new ceres::AutoDiffCostFunction<CeresEdge, 7, 3, 4, 1, 3, 4, 1>(new CeresEdge{edge}), nullptr,
        a.center.data(), a.rotation.data(), &a.log_scale, b.center.data(), b.rotation.data(), &b.log_scale);
  }
  for (Node& node : nodes) {
    problem.SetManifold(node.rotation.data(), new ceres::EigenQuaternionManifold);
    if (scale_is_known || &node == &nodes[0]) problem.SetParameterBlockConstant(&node.log_scale);
  }
  problem.SetParameterBlockConstant(nodes[0].center.data());
  problem.SetParameterBlockConstant(nodes[0].rotation.data());
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.max_num_iterations = 500;
  options.function_tolerance = function_tolerance;
  options.gradient_tolerance = options.parameter_tolerance = 1e-14;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  return summary;
}

}  // namespace raysfm::test
