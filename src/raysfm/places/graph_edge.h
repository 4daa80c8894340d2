#pragma once

#include <Eigen/Core>

#include "raysfm/geometry/pose.h"

namespace raysfm {

// A measured relation of two nodes of a graph of similarities. Standard deviations are infinite for what was
// not measured.
struct GraphEdge {
  int a = 0, b = 0;  // indices of the nodes
  Similarity3 b_from_a;
  double sigma_translation = 1;  // of each coordinate of b_from_a.translation, in the unit of length of b
  double sigma_rotation = 1;     // about each axis, radians
  double sigma_log_scale = 1;
};

// A node of the graph, by numbers in which relations are as nearly linear as can be: with scales and
// rotations right, translations are linear in the centres.
struct GraphNode {
  Eigen::Vector3d center = Eigen::Vector3d::Zero();  // the node's origin, in the world
  Eigen::Quaterniond node_from_world = Eigen::Quaterniond::Identity();
  double scale = 1;  // x_in_node = scale * node_from_world * (x_in_world - center)
};

// There and back.
GraphNode graph_node(const Similarity3& node_from_world);
Similarity3 similarity_of(const GraphNode& node);

// Tangent of a node: (v, w, l): center + v, exp(w) node_from_world, exp(l) scale.
using GraphTangent = Eigen::Matrix<double, 7, 1>;
GraphNode retract(const GraphNode& node, const GraphTangent& delta);

// Translation, rotation vector and logarithm of the scale of an edge.
using EdgeResidual = Eigen::Matrix<double, 7, 1>;
using EdgeJacobian = Eigen::Matrix<double, 7, 7>;

// Predicted less measured, in frame b, over the standard deviations.
EdgeResidual edge_residual(const GraphNode& a, const GraphNode& b, const GraphEdge& edge);

// The same with its derivatives by the tangents of both nodes.
EdgeResidual edge_residual(const GraphNode& a, const GraphNode& b, const GraphEdge& edge, EdgeJacobian* by_a,
                           EdgeJacobian* by_b);

}  // namespace raysfm
