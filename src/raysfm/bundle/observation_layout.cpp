#include "raysfm/bundle/observation_layout.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "raysfm/residuals/observation_block.h"

namespace raysfm {
namespace {

// Stable: `sorted` is `order` by ascending key.
template <typename Key>
void counting_sort(std::span<const int> order, size_t key_count, Key key, LargeArray<int>& counts,
                   LargeArray<int>& sorted) {
  counts.assign(key_count + 1, 0);
  for (int i : order) ++counts[key(i) + 1];
  for (size_t k = 0; k < key_count; ++k) counts[k + 1] += counts[k];
  sorted.resize(order.size());
  for (int i : order) sorted[counts[key(i)]++] = i;
}

bool is_free(const BundleProblem& problem, int pose) {
  return problem.pose_is_free.empty() || problem.pose_is_free[pose] != 0;
}
bool is_fixed(const BundleProblem& problem, int point) {
  return !problem.point_is_fixed.empty() && problem.point_is_fixed[point] != 0;
}
bool in_range(int index, size_t size) {
  return index >= 0 && static_cast<size_t>(index) < size;
}

}  // namespace

bool is_valid(const BundleProblem& problem, const BundleOptions& options) {
  constexpr size_t kMostObservations = std::numeric_limits<int>::max() / (2 * kBlockLanes);
  const size_t poses = problem.rig_from_world.size(), points = problem.points.size();
  const size_t observations = problem.observations.size();
  const auto fits = [](size_t flags, size_t size) { return flags == 0 || flags == size; };
  if (!fits(problem.pose_is_free.size(), poses) || !fits(problem.point_is_fixed.size(), points) ||
      !fits(problem.is_inlier.size(), observations) || !fits(problem.rays.size(), observations) ||
      !fits(problem.lenses.size(), poses) || !fits(problem.sigmas.size(), observations) ||
      (!problem.rays.empty() && !problem.lenses.empty())) {
    return false;
  }
  if (poses > kMostObservations || points > kMostObservations || observations > kMostObservations)
    return false;
  const bool needs_scale = options.loss.kind != RobustLoss::Kind::kNone;
  if (needs_scale && !(options.loss.scale > 0 && std::isfinite(options.loss.scale))) return false;
  if (options.threads < 1) return false;
  if (options.max_iterations < 1 || !(options.min_relative_decrease >= 0) || !(options.initial_damping > 0) ||
      !(options.settled >= 0)) {
    return false;
  }
  for (const float sigma : problem.sigmas) {
    if (!(sigma > 0 && std::isfinite(sigma))) return false;
  }
  const bool needs_camera = problem.rays.empty() && problem.lenses.empty();
  for (const BundleObservation& o : problem.observations) {
    if (!in_range(o.pose, poses) || !in_range(o.point, points) ||
        (needs_camera && !in_range(o.camera, problem.cameras.size()))) {
      return false;
    }
  }
  return true;
}

void ObservationLayout::build(const BundleProblem& problem, Taking taking) {
  sort_observations(problem, taking);
  fill_lanes(problem);
  weigh_lanes(problem);
  list_lanes_of_points();
  assign_slots();
  cut_chunks();
}

void ObservationLayout::sort_observations(const BundleProblem& problem, Taking taking) {
  order_.clear();
  order_.reserve(problem.observations.size());
  for (size_t i = 0; i < problem.observations.size(); ++i) {
    if (taking == Taking::kAll || problem.uses(i)) order_.push_back(static_cast<int>(i));
  }
  if (problem.cameras.size() > 1 && problem.rays.empty() && problem.lenses.empty()) {
    const auto camera = [&](int i) { return problem.observations[i].camera; };
    counting_sort(order_, problem.cameras.size(), camera, counts_, sorted_);
    order_.swap(sorted_);
  }
  const auto pose = [&](int i) { return problem.observations[i].pose; };
  counting_sort(order_, problem.rig_from_world.size(), pose, counts_, sorted_);
}

void ObservationLayout::fill_lanes(const BundleProblem& problem) {
  groups.clear(), lanes.clear(), u.clear(), v.clear(), poses.clear(), points.clear();
  system_point_.assign(problem.points.size(), -1);
  const bool one_camera = !problem.rays.empty() || !problem.lenses.empty();  // cameras are not looked at
  reserve_lanes(problem.rig_from_world.size() * (one_camera ? 1 : problem.cameras.size()));
  const auto pad = [&] {
    while (lanes.size() % kBlockLanes != 0) {
      lanes.push_back({-1, lanes.back().point, -1, -1, false});
      u.push_back(0), v.push_back(0);
    }
    if (!groups.empty()) groups.back().end = static_cast<int>(lanes.size());
  };
  for (int i : sorted_) {
    const BundleObservation& o = problem.observations[i];
    if (groups.empty() || groups.back().pose != o.pose || (!one_camera && groups.back().camera != o.camera)) {
      pad();
      int system_pose = -1;
      if (is_free(problem, o.pose)) {
        if (poses.empty() || poses.back() != o.pose) poses.push_back(o.pose);
        system_pose = static_cast<int>(poses.size()) - 1;
      }
      const int begin = static_cast<int>(lanes.size());
      const bool opens_pose = groups.empty() || groups.back().pose != o.pose;
      groups.push_back({o.pose, o.camera, system_pose, begin, begin, opens_pose});
    }
    int& system_point = system_point_[o.point];
    if (system_point < 0 && !is_fixed(problem, o.point)) {
      system_point = static_cast<int>(points.size());
      points.push_back(o.point);
    }
    lanes.push_back({i, o.point, system_point, -1, false});
    u.push_back(o.pixel.x()), v.push_back(o.pixel.y());
  }
  pad();
}

// Arrays that grow by themselves leave holes of their size in the heap.
void ObservationLayout::reserve_lanes(size_t most_groups) {
  const size_t most = sorted_.size() + kBlockLanes * std::min(sorted_.size(), most_groups);
  lanes.reserve(most), u.reserve(most), v.reserve(most), weight.reserve(most);
}

void ObservationLayout::weigh_lanes(const BundleProblem& problem) {
  weight.clear();
  if (problem.sigmas.empty()) return;
  for (const Lane& lane : lanes) {
    const double sigma = lane.observation < 0 ? 1.0 : problem.sigmas[lane.observation];
    weight.push_back(1.0 / (sigma * sigma));
  }
}

void ObservationLayout::list_lanes_of_points() {
  lane_begin.assign(points.size() + 1, 0);
  for (const Lane& lane : lanes) {
    if (lane.system_point >= 0) ++lane_begin[lane.system_point + 1];
  }
  for (size_t p = 0; p < points.size(); ++p) lane_begin[p + 1] += lane_begin[p];
  place_.assign(lane_begin.begin(), lane_begin.end() - 1);
  lanes_of_point.resize(lane_begin.back());
  for (size_t k = 0; k < lanes.size(); ++k) {
    if (lanes[k].system_point >= 0) lanes_of_point[place_[lanes[k].system_point]++] = static_cast<int>(k);
  }
}

// Lanes come by pose, so a point's lanes are met in the order of their poses.
void ObservationLayout::assign_slots() {
  group_of_block_.resize(lanes.size() / kBlockLanes);
  for (size_t g = 0; g < groups.size(); ++g) {
    for (int k = groups[g].begin; k < groups[g].end; k += kBlockLanes) {
      group_of_block_[k / kBlockLanes] = static_cast<int>(g);
    }
  }
  point_begin.assign(1, 0);
  pose_of_slot.clear();
  pose_of_slot.reserve(lanes_of_point.size());
  for (size_t p = 0; p < points.size(); ++p) {
    for (int k = lane_begin[p]; k < lane_begin[p + 1]; ++k) {
      Lane& lane = lanes[lanes_of_point[k]];
      const int pose = groups[group_of_block_[lanes_of_point[k] / kBlockLanes]].system_pose;
      if (pose < 0) continue;
      const int first_of_point = point_begin.back();
      lane.opens_slot =
          static_cast<int>(pose_of_slot.size()) == first_of_point || pose_of_slot.back() != pose;
      if (lane.opens_slot) pose_of_slot.push_back(pose);
      lane.slot = static_cast<int>(pose_of_slot.size()) - 1;
    }
    point_begin.push_back(static_cast<int>(pose_of_slot.size()));
  }
}

void ObservationLayout::cut_chunks() {
  constexpr int kLeastLanes = 1024;
  chunks.assign(1, 0);
  for (size_t g = 0; g < groups.size(); ++g) {
    if (groups[g].opens_pose && groups[g].begin - groups[chunks.back()].begin >= kLeastLanes) {
      chunks.push_back(static_cast<int>(g));
    }
  }
  chunks.push_back(static_cast<int>(groups.size()));
}

}  // namespace raysfm
