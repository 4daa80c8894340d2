// How a map is held against those that look nearly the same.
#include <algorithm>
#include <cmath>

#include "raysfm/bundle/residual.h"
#include "raysfm/mapping/mapper.h"
#include "raysfm/mapping/planar_twin.h"
#include "raysfm/mapping/relief.h"

namespace raysfm {
namespace {

// Part of what the worst inliers cost that a rival costs at most before it is adjusted: where a lens is wide,
// that inside out costs more, and where there is no plane, the twin. And what it costs at most where it is
// taken, and at least where it is not asked for again, in parts of what the map costs.
constexpr double kMostUnadjusted = 0.8, kClearlyBetter = 0.9, kSurelyWorse = 4;

}  // namespace

// Makes the window the rival; false where there is none.
bool Mapper::take_rival(Rival rival) {
  if (window_.points.empty()) return false;
  bool is_rival = true;
  const Rigid3 cam_from_rig = rig_.cam_from_rig(0), rig_from_cam = cam_from_rig.inverse();
  for (Rigid3& pose : window_.poses) pose = cam_from_rig * pose;
  if (rival == Rival::kInsideOut) reverse_relief(window_.poses, window_.points);
  if (rival == Rival::kPlanarTwin) is_rival = take_planar_twin(window_.poses, window_.points);
  for (Rigid3& pose : window_.poses) pose = rig_from_cam * pose;
  std::ranges::fill(window_.inliers, 1);
  return is_rival;
}

// What the rival costs once it is adjusted, in parts of what the map does. It stays in the window where that
// is clearly less. Infinite where it is no rival.
double Mapper::weigh_rival(Rival rival, const Map& map) {
  gather(&map, 0, 0);
  const BundleProblem problem = window_problem(map);
  const double worst = kInlierError * kInlierError * static_cast<double>(window_.observations.size());
  const double as_it_is = truncated_cost(problem, kInlierError);
  double cost = INFINITY;
  if (take_rival(rival) && truncated_cost(problem, kInlierError) < kMostUnadjusted * worst) {
    adjuster_.adjust_two_stage(problem, kAdjustment, kAdjustment, kInlierError);
    cost = truncated_cost(problem, kInlierError);
  }
  if (!(cost < kClearlyBetter * as_it_is)) {
    for (const int t : window_.tracks) window_.point_of_track[t] = -1;
  }
  return cost / as_it_is;
}

Relief Mapper::choose_relief(Map* map) {
  if (rig_.size() > 1 || !rig_.central()) return Relief::kSurelyStays;  // the rays tell them apart
  ScopedTimer timer(adjust_timing);
  double least = INFINITY;
  for (const Rival rival : {Rival::kInsideOut, Rival::kPlanarTwin}) {
    const double cost = weigh_rival(rival, *map);
    if (cost < kClearlyBetter) {
      scatter(0, map);
      return Relief::kReversed;
    }
    least = std::min(least, cost);
  }
  return least > kSurelyWorse && least < INFINITY ? Relief::kSurelyStays : Relief::kStays;
}

}  // namespace raysfm
