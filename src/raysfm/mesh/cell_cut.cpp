#include "raysfm/mesh/cell_cut.h"

#include <algorithm>

namespace raysfm {
namespace {

// In place of an arc to the parent.
constexpr int kNone = -1, kRoot = -2, kOrphan = -3;

}  // namespace

CellCut::CellCut(const std::vector<Tetrahedron>& cells)
    : cells_(cells),
      residual_(4 * cells.size(), 0),
      terminal_(cells.size(), 0),
      reverse_(4 * cells.size(), kNone),
      tree_(cells.size(), Tree::kFree),
      parent_(cells.size(), kNone),
      distance_(cells.size(), 0),
      stamp_(cells.size(), 0),
      is_active_(cells.size(), 0) {
  for (size_t arc = 0; arc < reverse_.size(); ++arc) {
    const int there = head(static_cast<int>(arc));
    if (there < 0) continue;
    const auto& back = cells[there].neighbours;
    const auto face = std::ranges::find(back, static_cast<int>(arc / 4)) - back.begin();
    reverse_[arc] = 4 * there + static_cast<int>(face);
  }
}

// What a cell costs on both sides it costs anyway.
void CellCut::add_if_inside(int cell, int64_t cost) {
  if (terminal_[cell] < 0) flow_ += std::min(cost, -terminal_[cell]);
  terminal_[cell] += cost;
}

void CellCut::add_if_outside(int cell, int64_t cost) {
  if (terminal_[cell] > 0) flow_ += std::min(cost, terminal_[cell]);
  terminal_[cell] -= cost;
}

void CellCut::mark(int node, int distance) {
  distance_[node] = distance;
  stamp_[node] = now_;
}

void CellCut::start_trees() {
  for (size_t i = 0; i < cells_.size(); ++i) {
    if (terminal_[i] == 0) continue;
    tree_[i] = terminal_[i] > 0 ? Tree::kOutside : Tree::kInside;
    parent_[i] = kRoot;
    mark(static_cast<int>(i), 1);
    active_.push_back(static_cast<int>(i));
    is_active_[i] = 1;
  }
}

// Lets the tree of a node take its free neighbours. The arc, from the outside tree, that leads to the other
// tree; kNone where none does.
int CellCut::grow(int node) {
  const bool outside = tree_[node] == Tree::kOutside;
  for (int arc = 4 * node; arc < 4 * node + 4; ++arc) {
    const int next = head(arc);
    if (next < 0) continue;
    const int back = reverse(arc);
    if (residual_[outside ? arc : back] == 0) continue;
    if (tree_[next] == Tree::kFree) {
      tree_[next] = tree_[node];
      parent_[next] = back;
      distance_[next] = distance_[node] + 1;
      stamp_[next] = stamp_[node];
      if (!is_active_[next]) active_.push_back(next);
      is_active_[next] = 1;
    } else if (tree_[next] != tree_[node]) {
      return outside ? arc : back;
    } else if (stamp_[next] <= stamp_[node] && distance_[next] > distance_[node]) {
      parent_[next] = back;  // a shorter way to the root
      distance_[next] = distance_[node] + 1;
      stamp_[next] = stamp_[node];
    }
  }
  return kNone;
}

int64_t CellCut::bottleneck(int node, int64_t flow) {
  for (; parent_[node] != kRoot; node = head(parent_[node])) flow = std::min(flow, tree_residual(node));
  return std::min(flow, std::abs(terminal_[node]));
}

void CellCut::push(int node, int64_t flow) {
  const bool outside = tree_[node] == Tree::kOutside;
  while (parent_[node] != kRoot) {
    const int up = parent_[node], next = head(up);
    residual_[up] += outside ? flow : -flow;
    residual_[reverse(up)] += outside ? -flow : flow;
    if (tree_residual(node) == 0) {
      parent_[node] = kOrphan;
      orphans_.push_front(node);
    }
    node = next;
  }
  terminal_[node] += outside ? -flow : flow;
  if (terminal_[node] == 0) {
    parent_[node] = kOrphan;
    orphans_.push_front(node);
  }
}

void CellCut::augment(int arc) {
  const int from = arc / 4, to = head(arc);
  const int64_t flow = bottleneck(to, bottleneck(from, residual_[arc]));
  residual_[arc] -= flow;
  residual_[reverse(arc)] += flow;
  push(from, flow);
  push(to, flow);
  flow_ += flow;
}

// Whether the parents of a node lead to the root, and over how many nodes, itself and the root included.
bool CellCut::reaches_root(int node, int* distance) {
  int count = 0;
  for (int at = node;; at = head(parent_[at])) {
    if (stamp_[at] == now_) {
      count += distance_[at];
      break;
    }
    ++count;
    if (parent_[at] == kRoot) break;
    if (parent_[at] < 0) return false;
  }
  *distance = count;
  for (int at = node; stamp_[at] != now_; at = head(parent_[at])) {
    mark(at, count--);
    if (parent_[at] == kRoot) break;
  }
  return true;
}

void CellCut::adopt(int orphan) {
  const bool outside = tree_[orphan] == Tree::kOutside;
  int best = kNone, least = 0;
  for (int arc = 4 * orphan; arc < 4 * orphan + 4; ++arc) {
    const int next = head(arc);
    if (next < 0 || tree_[next] != tree_[orphan]) continue;
    if (residual_[outside ? reverse(arc) : arc] == 0) continue;
    int distance = 0;
    if (!reaches_root(next, &distance)) continue;
    if (best != kNone && distance >= least) continue;
    best = arc;
    least = distance;
  }
  parent_[orphan] = best;
  if (best != kNone) return mark(orphan, least + 1);
  for (int arc = 4 * orphan; arc < 4 * orphan + 4; ++arc) {
    const int next = head(arc);
    if (next < 0 || tree_[next] != tree_[orphan]) continue;
    if (residual_[outside ? reverse(arc) : arc] > 0 && !is_active_[next]) {
      active_.push_back(next);
      is_active_[next] = 1;
    }
    if (parent_[next] >= 0 && head(parent_[next]) == orphan) {
      parent_[next] = kOrphan;
      orphans_.push_back(next);
    }
  }
  tree_[orphan] = Tree::kFree;
}

void CellCut::adopt() {
  while (!orphans_.empty()) {
    const int orphan = orphans_.front();
    orphans_.pop_front();
    adopt(orphan);
  }
}

int64_t CellCut::solve() {
  start_trees();
  while (!active_.empty()) {
    const int node = active_.front();
    if (tree_[node] != Tree::kFree) {
      if (const int arc = grow(node); arc != kNone) {
        ++now_;
        augment(arc);
        adopt();
        continue;  // its other neighbours
      }
    }
    is_active_[node] = 0;
    active_.pop_front();
  }
  return flow_;
}

}  // namespace raysfm
