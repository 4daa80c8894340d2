#include "raysfm/eval/association.h"

#include <algorithm>
#include <cmath>

namespace raysfm {
namespace {

// Index of the element of the sorted, non-empty list that is nearest to `time`; the earlier one of a tie.
int nearest(std::span<const double> times, double time) {
  const auto after = std::lower_bound(times.begin(), times.end(), time);
  if (after == times.begin()) return 0;
  const int index = static_cast<int>(after - times.begin());
  if (after == times.end()) return index - 1;
  return time - *(after - 1) <= *after - time ? index - 1 : index;
}

}  // namespace

std::vector<Match> associate(std::span<const double> estimate, std::span<const double> truth, double max_dt) {
  std::vector<Match> matches;
  if (truth.empty()) return matches;
  for (int i = 0; i < static_cast<int>(estimate.size()); ++i) {
    const int j = nearest(truth, estimate[i]);
    if (std::abs(truth[j] - estimate[i]) <= max_dt && nearest(estimate, truth[j]) == i) {
      matches.push_back({i, j});
    }
  }
  return matches;
}

}  // namespace raysfm
