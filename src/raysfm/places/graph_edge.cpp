#include "raysfm/places/graph_edge.h"

#include <cmath>

namespace raysfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// The derivative of log(exp(w) exp(theta)) by w at zero.
Matrix3d log_derivative(const Vector3d& theta) {
  const Matrix3d k = skew(theta);
  const double angle2 = theta.squaredNorm();
  double c = 1.0 / 12.0 + angle2 / 720.0;
  if (angle2 > 1e-4) {
    const double half = 0.5 * std::sqrt(angle2);
    c = (1.0 - half / std::tan(half)) / angle2;
  }
  return Matrix3d::Identity() - 0.5 * k + c * k * k;
}

// Where node b puts the origin of node a.
Vector3d translation(const GraphNode& a, const GraphNode& b) {
  return b.scale * (b.node_from_world * (a.center - b.center));
}

Eigen::Quaterniond rotation(const GraphNode& a, const GraphNode& b) {
  return b.node_from_world * a.node_from_world.conjugate();
}

}  // namespace

GraphNode graph_node(const Similarity3& node_from_world) {
  const Eigen::Quaterniond r = node_from_world.rotation.normalized();
  return {-(r.conjugate() * node_from_world.translation) / node_from_world.scale, r, node_from_world.scale};
}

Similarity3 similarity_of(const GraphNode& node) {
  return {node.scale, node.node_from_world, -node.scale * (node.node_from_world * node.center)};
}

GraphNode retract(const GraphNode& node, const GraphTangent& delta) {
  return {node.center + delta.head<3>(), (exp_so3(delta.segment<3>(3)) * node.node_from_world).normalized(),
          node.scale * std::exp(delta[6])};
}

EdgeResidual edge_residual(const GraphNode& a, const GraphNode& b, const GraphEdge& edge) {
  const Similarity3& measured = edge.b_from_a;
  EdgeResidual r;
  r.head<3>() = (translation(a, b) - measured.translation) / edge.sigma_translation;
  r.segment<3>(3) = log_so3(rotation(a, b) * measured.rotation.conjugate()) / edge.sigma_rotation;
  r[6] = std::log(b.scale / (a.scale * measured.scale)) / edge.sigma_log_scale;
  return r;
}

EdgeResidual edge_residual(const GraphNode& a, const GraphNode& b, const GraphEdge& edge, EdgeJacobian* by_a,
                           EdgeJacobian* by_b) {
  const EdgeResidual r = edge_residual(a, b, edge);
  const double per_translation = 1 / edge.sigma_translation, per_rotation = 1 / edge.sigma_rotation,
               per_scale = 1 / edge.sigma_log_scale;
  const Vector3d t = per_translation * translation(a, b);
  const Matrix3d b_from_world = (per_translation * b.scale) * b.node_from_world.toRotationMatrix();
  const Vector3d theta = log_so3(rotation(a, b) * edge.b_from_a.rotation.conjugate());
  const Matrix3d turn = per_rotation * log_derivative(theta);
  by_a->setZero();
  by_a->block<3, 3>(0, 0) = b_from_world;
  by_a->block<3, 3>(3, 3) = -turn * rotation(a, b).toRotationMatrix();
  (*by_a)(6, 6) = -per_scale;
  by_b->setZero();
  by_b->block<3, 3>(0, 0) = -b_from_world;
  by_b->block<3, 3>(0, 3) = -skew(t);
  by_b->block<3, 1>(0, 6) = t;
  by_b->block<3, 3>(3, 3) = turn;
  (*by_b)(6, 6) = per_scale;
  return r;
}

}  // namespace raysfm
