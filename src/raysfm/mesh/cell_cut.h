#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <vector>

#include "raysfm/mesh/tetrahedra.h"

namespace raysfm {

// Divides tetrahedra into outside and inside at the least cost (a minimal cut; Boykov and Kolmogorov 2004).
// Costs are integers, so that the division does not depend on the order in which they were added.
class CellCut {
 public:
  // `cells` must outlive it.
  explicit CellCut(const std::vector<Tetrahedron>& cells);

  // Costs, >= 0, if `cell` is outside and what lies beyond its face `face` inside.
  void add_face(int cell, int face, int64_t cost) { residual_[4 * cell + face] += cost; }
  // Costs if `cell` is inside, or outside.
  void add_if_inside(int cell, int64_t cost);
  void add_if_outside(int cell, int64_t cost);

  // Divides; once. The least cost.
  int64_t solve();
  // After solve(). Cells that cost the same on either side are inside.
  bool is_outside(int cell) const { return tree_[cell] == Tree::kOutside; }

 private:
  enum class Tree : uint8_t { kFree, kOutside, kInside };

  int head(int arc) const { return cells_[arc / 4].neighbours[arc % 4]; }
  int reverse(int arc) const { return reverse_[arc]; }
  // What can still flow from parent to child in the outside tree, and back in the other.
  int64_t& tree_residual(int node) {
    return residual_[tree_[node] == Tree::kOutside ? reverse(parent_[node]) : parent_[node]];
  }
  void start_trees();
  int grow(int node);
  void augment(int arc);
  int64_t bottleneck(int node, int64_t flow);
  void push(int node, int64_t flow);
  void adopt();
  void adopt(int orphan);
  bool reaches_root(int node, int* distance);
  void mark(int node, int distance);

  const std::vector<Tetrahedron>& cells_;
  std::vector<int64_t> residual_;  // by arc: 4 * cell + face
  std::vector<int64_t> terminal_;  // by cell: > 0 from outside, < 0 to inside
  std::vector<int> reverse_;       // by arc
  std::vector<Tree> tree_;
  std::vector<int> parent_;    // by cell: arc to its parent
  std::vector<int> distance_;  // to the root, as of `stamp_`
  std::vector<int> stamp_;
  int now_ = 0;
  int64_t flow_ = 0;
  std::deque<int> active_, orphans_;
  std::vector<uint8_t> is_active_;
};

}  // namespace raysfm
