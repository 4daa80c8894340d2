#pragma once

#include <cstdint>
#include <span>

#include "raysfm/optim/levenberg_marquardt.h"
#include "raysfm/places/graph_edge.h"

namespace raysfm {

// How a graph is adjusted.
struct GraphOptions {
  bool scale_is_known = false;  // scales of all nodes are held, and what edges say of them is ignored
  int max_iterations = 50;
  double min_relative_decrease = 1e-9;  // of the cost, below which an accepted step is the last
};

// Moves the nodes (node_from_world) to the least sum of squares of the edges' residuals. Nodes with is_free 0
// are held, and so is the first node of every connected part of the graph that has no other held one; those
// and nodes without edges do not change by a bit. The cost is half the sum of squares.
//
// Every edge counts in full, since one that is right may be thousands of standard deviations off before its
// loop is closed. edge_residual() says afterwards which one the others contradict.
//
// Where sizes or indices contradict each other, an edge joins a node with itself, or a number is not finite
// (standard deviations: positive; scales: positive), nothing is changed: kInvalidProblem.
LmSummary adjust_graph(std::span<Similarity3> node_from_world, std::span<const uint8_t> is_free,
                       std::span<const GraphEdge> edges, const GraphOptions& options = {});

}  // namespace raysfm
