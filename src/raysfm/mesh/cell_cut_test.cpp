#include "raysfm/mesh/cell_cut.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "raysfm/core/random.h"

namespace raysfm {
namespace {

struct Costs {
  std::vector<std::array<int64_t, 4>> face;
  std::vector<int64_t> inside, outside;
};

Tetrahedra some_tetrahedra(int points) {
  Rng rng(static_cast<uint64_t>(points));
  Tetrahedra t(Eigen::AlignedBox3d(Eigen::Vector3d::Zero(), Eigen::Vector3d::Ones()));
  for (int i = 0; i < points; ++i) {
    t.add({rng.uniform(0.05, 0.95), rng.uniform(0.05, 0.95), rng.uniform(0.05, 0.95)});
  }
  return t;
}

Costs random_costs(size_t cells, Rng& rng) {
  Costs costs{std::vector<std::array<int64_t, 4>>(cells), std::vector<int64_t>(cells),
              std::vector<int64_t>(cells)};
  for (size_t c = 0; c < cells; ++c) {
    for (int64_t& cost : costs.face[c]) cost = rng.index(30);
    if (rng.index(3) == 0) costs.inside[c] = rng.index(90);
    if (rng.index(3) == 0) costs.outside[c] = rng.index(90);
  }
  return costs;
}

int64_t cost_of(const std::vector<Tetrahedron>& cells, const Costs& costs, const std::vector<bool>& outside) {
  int64_t sum = 0;
  for (size_t c = 0; c < cells.size(); ++c) {
    sum += outside[c] ? costs.outside[c] : costs.inside[c];
    for (int k = 0; k < 4; ++k) {
      const int next = cells[c].neighbours[k];
      if (next >= 0 && outside[c] && !outside[static_cast<size_t>(next)]) sum += costs.face[c][k];
    }
  }
  return sum;
}

int64_t solve(const std::vector<Tetrahedron>& cells, const Costs& costs, std::vector<bool>* outside) {
  CellCut cut(cells);
  for (size_t c = 0; c < cells.size(); ++c) {
    const int cell = static_cast<int>(c);
    cut.add_if_inside(cell, costs.inside[c]);
    cut.add_if_outside(cell, costs.outside[c]);
    for (int k = 0; k < 4; ++k) {
      if (cells[c].neighbours[k] >= 0) cut.add_face(cell, k, costs.face[c][k]);
    }
  }
  const int64_t least = cut.solve();
  for (size_t c = 0; c < cells.size(); ++c) outside->push_back(cut.is_outside(static_cast<int>(c)));
  return least;
}

TEST(CellCut, IsTheBestOfAllDivisions) {
  const Tetrahedra t = some_tetrahedra(1);
  const size_t n = t.cells().size();
  ASSERT_LE(n, 16u);
  Rng rng(7);
  for (int trial = 0; trial < 50; ++trial) {
    const Costs costs = random_costs(n, rng);
    int64_t best = std::numeric_limits<int64_t>::max();
    for (unsigned division = 0; division < 1u << n; ++division) {
      std::vector<bool> outside;
      for (size_t c = 0; c < n; ++c) outside.push_back((division >> c & 1) != 0);
      best = std::min(best, cost_of(t.cells(), costs, outside));
    }
    std::vector<bool> outside;
    EXPECT_EQ(solve(t.cells(), costs, &outside), best);
    EXPECT_EQ(cost_of(t.cells(), costs, outside), best);
  }
}

// A flow that is as large as the cost of a division proves both: no flow is larger than any division's cost.
TEST(CellCut, ManyCells) {
  for (int points = 10; points <= 2000; points *= 3) {
    const Tetrahedra t = some_tetrahedra(points);
    Rng rng(3);
    const Costs costs = random_costs(t.cells().size(), rng);
    std::vector<bool> outside;
    const int64_t least = solve(t.cells(), costs, &outside);
    EXPECT_EQ(least, cost_of(t.cells(), costs, outside)) << points;
    EXPECT_NE(std::ranges::count(outside, true), 0);
  }
}

}  // namespace
}  // namespace raysfm
