#pragma once

#include <span>
#include <vector>

namespace raysfm {

struct Match {
  int estimate = 0;  // index of a pose of the estimate
  int truth = 0;     // index of the pose of the truth at the same time
};

// Pairs the poses of two trajectories that are nearest to each other in time and at most `max_dt` seconds
// apart. One to one: a pose takes part only when it is also the nearest of its nearest. Both lists strictly
// increase, and so do the matches.
std::vector<Match> associate(std::span<const double> estimate, std::span<const double> truth, double max_dt);

}  // namespace raysfm
