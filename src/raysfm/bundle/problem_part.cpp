#include "raysfm/bundle/problem_part.h"

#include <algorithm>

namespace raysfm {

ObservationsByPose::ObservationsByPose(const BundleProblem& problem)
    : begin(problem.rig_from_world.size() + 1, 0) {
  for (size_t i = 0; i < problem.observations.size(); ++i) {
    if (problem.uses(i)) ++begin[problem.observations[i].pose + 1];
  }
  for (size_t i = 1; i < begin.size(); ++i) begin[i] += begin[i - 1];
  LargeArray<int> place = begin;
  observations.resize(begin.back());
  for (size_t i = 0; i < problem.observations.size(); ++i) {
    if (problem.uses(i)) observations[place[problem.observations[i].pose]++] = static_cast<int>(i);
  }
}

void ProblemPart::cut(const BundleProblem& whole, const ObservationsByPose& by_pose, int first, int last,
                      int first_free, bool skip_unmoved) {
  cameras_ = whole.cameras;
  first_ = first;
  has_lenses_ = !whole.lenses.empty();
  poses.assign(whole.rig_from_world.begin() + first, whole.rig_from_world.begin() + last);
  lenses.clear();
  if (has_lenses_) lenses.assign(whole.lenses.begin() + first, whole.lenses.begin() + last);
  pose_is_free_.clear();
  for (int i = first; i < last; ++i) {
    pose_is_free_.push_back(i >= first_free && (whole.pose_is_free.empty() || whole.pose_is_free[i]));
  }
  number_points(whole, by_pose, skip_unmoved);
  observations_.clear(), rays_.clear(), sigmas_.clear();
  for (int k = by_pose.begin[first]; k < by_pose.begin[last]; ++k) {
    const int i = by_pose.observations[k];
    BundleObservation o = whole.observations[i];
    const int local = local_[o.point];
    if (local < 0) continue;
    o.pose -= first;
    o.point = local;
    observations_.push_back(o);
    if (!whole.rays.empty()) rays_.push_back(whole.rays[i]);
    if (!whole.sigmas.empty()) sigmas_.push_back(whole.sigmas[i]);
  }
  for (int p : point_ids) local_[p] = -1;
}

void ProblemPart::number_points(const BundleProblem& whole, const ObservationsByPose& by_pose,
                                bool skip_unmoved) {
  sightings_.resize(whole.points.size(), 0);
  moves_.resize(whole.points.size(), 0);
  local_.resize(whole.points.size(), -1);
  points.clear(), point_ids.clear(), point_is_fixed_.clear();
  const int first = first_, last = this->last();
  for (int i = first; i < last; ++i) {
    for (int k = by_pose.begin[i]; k < by_pose.begin[i + 1]; ++k) {
      const int p = whole.observations[by_pose.observations[k]].point;
      ++sightings_[p];
      if (pose_is_free_[i - first]) moves_[p] = 1;
    }
  }
  for (int k = by_pose.begin[first]; k < by_pose.begin[last]; ++k) {
    const int p = whole.observations[by_pose.observations[k]].point;
    const bool is_fixed = !whole.point_is_fixed.empty() && whole.point_is_fixed[p];
    if ((sightings_[p] > 1 || (sightings_[p] == 1 && is_fixed)) && (moves_[p] || !skip_unmoved)) {
      local_[p] = static_cast<int>(point_ids.size());
      point_ids.push_back(p);
      points.push_back(whole.points[p]);
      point_is_fixed_.push_back(is_fixed);
    }
    sightings_[p] = 0, moves_[p] = 0;
  }
}

BundleProblem ProblemPart::problem() {
  return {cameras_, poses, pose_is_free_, points, point_is_fixed_, observations_, {}, rays_, lenses, sigmas_};
}

bool ProblemPart::is_anchored() const {
  return std::find(pose_is_free_.begin(), pose_is_free_.end(), 0) != pose_is_free_.end() ||
         std::find(point_is_fixed_.begin(), point_is_fixed_.end(), 1) != point_is_fixed_.end();
}

void ProblemPart::store(const BundleProblem& whole) const {
  for (size_t i = 0; i < poses.size(); ++i) {
    if (!pose_is_free_[i]) continue;
    whole.rig_from_world[first_ + i] = poses[i];
    if (has_lenses_) whole.lenses[first_ + i] = lenses[i];
  }
  for (size_t p = 0; p < points.size(); ++p) {
    if (!point_is_fixed_[p]) whole.points[point_ids[p]] = points[p];
  }
}

PartOfPoints::PartOfPoints(const BundleProblem& whole, std::span<const uint8_t> is_chosen, bool chosen)
    : whole_(whole) {
  std::vector<int> number(whole.points.size(), -1);
  for (size_t p = 0; p < whole.points.size(); ++p) {
    if ((is_chosen[p] != 0) != chosen) continue;
    number[p] = static_cast<int>(point_ids_.size());
    point_ids_.push_back(static_cast<int>(p));
    points_.push_back(whole.points[p]);
    if (!whole.point_is_fixed.empty()) point_is_fixed_.push_back(whole.point_is_fixed[p]);
  }
  reserve(std::ranges::count_if(whole.observations,
                                [&](const BundleObservation& o) { return number[o.point] >= 0; }));
  for (size_t i = 0; i < whole.observations.size(); ++i) {
    BundleObservation o = whole.observations[i];
    if (number[o.point] < 0) continue;
    o.point = number[o.point];
    ids_.push_back(static_cast<int>(i));
    observations_.push_back(o);
    is_inlier_.push_back(whole.uses(i));
    if (!whole.rays.empty()) rays_.push_back(whole.rays[i]);
    if (!whole.sigmas.empty()) sigmas_.push_back(whole.sigmas[i]);
  }
}

// Arrays that grow by themselves are copied again and again.
void PartOfPoints::reserve(size_t observations) {
  ids_.reserve(observations);
  observations_.reserve(observations);
  is_inlier_.reserve(observations);
  if (!whole_.rays.empty()) rays_.reserve(observations);
  if (!whole_.sigmas.empty()) sigmas_.reserve(observations);
}

BundleProblem PartOfPoints::problem() {
  BundleProblem part = whole_;  // poses are those of the whole
  part.points = points_;
  part.point_is_fixed = point_is_fixed_;
  part.observations = observations_;
  part.is_inlier = is_inlier_;
  part.rays = rays_;
  part.sigmas = sigmas_;
  return part;
}

void PartOfPoints::store() const {
  for (size_t p = 0; p < point_ids_.size(); ++p) whole_.points[point_ids_[p]] = points_[p];
  if (whole_.is_inlier.empty()) return;
  for (size_t i = 0; i < ids_.size(); ++i) whole_.is_inlier[ids_[i]] = is_inlier_[i];
}

}  // namespace raysfm
