#include "raysfm/bundle/hierarchy.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <memory>

#include "raysfm/bundle/bundle_adjuster.h"
#include "raysfm/bundle/problem_cost.h"
#include "raysfm/bundle/problem_part.h"
#include "raysfm/geometry/point_alignment.h"
#include "raysfm/geometry/similarity.h"

namespace raysfm {
namespace {

Eigen::Vector3d center(const Rigid3& rig_from_world) {
  return rig_from_world.inverse().translation;
}

void move(ProblemPart* part, const Similarity3& b_from_a) {
  for (Rigid3& pose : part->poses) pose = carried_over(pose, b_from_a);
  for (Eigen::Vector3d& point : part->points) point = b_from_a * point;
}

class Hierarchy {
 public:
  Hierarchy(const BundleProblem& problem, const BundleOptions& options, const HierarchyOptions& hierarchy)
      : problem_(problem),
        options_(options),
        hierarchy_(hierarchy),
        by_pose_(problem),
        with_scale_(!scale_is_observed(problem)),
        start_(problem.rig_from_world.begin(), problem.rig_from_world.end()),
        local_(problem.points.size(), -1) {}

  HierarchyResult run() {
    const int count = static_cast<int>(problem_.rig_from_world.size());
    if (count <= hierarchy_.piece) return {};
    solve(0, count, false)->store(problem_);
    return result_;
  }

 private:
  std::unique_ptr<ProblemPart> solve(int first, int last, bool adjusts) {
    auto whole = std::make_unique<ProblemPart>();
    whole->cut(problem_, by_pose_, first, last, first, false);
    if (last - first > hierarchy_.piece) {
      const int middle = first + (last - first) / 2, overlap = hierarchy_.overlap;
      const std::unique_ptr<ProblemPart> left = solve(first, middle + (overlap + 1) / 2, true);
      const std::unique_ptr<ProblemPart> right = solve(middle - overlap / 2, last, true);
      join(left.get(), right.get(), whole.get());
    }
    if (adjusts && !result_.interrupted) {
      const BundleSummary summary = adjuster_.adjust(whole->problem(), options_);
      result_.iterations += summary.iterations;
      result_.interrupted = summary.termination == Termination::kInterrupted;
    }
    return whole;
  }

  void join(ProblemPart* left, ProblemPart* right, ProblemPart* whole) {
    std::vector<Eigen::Vector3d> in_left, in_right;
    for (int i = right->first(); i < left->last(); ++i) {
      in_left.push_back(center(left->poses[i - left->first()]));
      in_right.push_back(center(right->poses[i - right->first()]));
    }
    for (size_t p = 0; p < left->points.size(); ++p) local_[left->point_ids[p]] = static_cast<int>(p);
    for (size_t p = 0; p < right->points.size(); ++p) {
      const int twin = local_[right->point_ids[p]];
      if (twin < 0 || !left->points[twin].allFinite() || !right->points[p].allFinite()) continue;
      in_left.push_back(left->points[twin]);
      in_right.push_back(right->points[p]);
    }
    for (int p : left->point_ids) local_[p] = -1;
    if (!left->is_anchored() || !right->is_anchored()) {
      const Similarity3 left_from_right = align_points(in_right, in_left, with_scale_);
      if (right->is_anchored()) {
        move(left, inverse(left_from_right));
      } else {
        move(right, left_from_right);
      }
    }
    fill(*left, *right, whole);
  }

  // What both have is taken from the left. Points that neither had (seen once in each) follow the first pose
  // that sees them.
  void fill(const ProblemPart& left, const ProblemPart& right, ProblemPart* whole) {
    for (size_t p = 0; p < whole->points.size(); ++p) local_[whole->point_ids[p]] = static_cast<int>(p);
    std::vector<uint8_t> has_value(whole->points.size(), 0);
    for (const ProblemPart* part : {&right, &left}) {
      const int shift = part->first() - whole->first();
      std::copy(part->poses.begin(), part->poses.end(), whole->poses.begin() + shift);
      std::copy(part->lenses.begin(), part->lenses.end(),
                whole->lenses.begin() + (part->lenses.empty() ? 0 : shift));
      for (size_t p = 0; p < part->points.size(); ++p) {
        const int place = local_[part->point_ids[p]];
        if (place < 0) continue;
        whole->points[place] = part->points[p];
        has_value[place] = 1;
      }
    }
    for (int i = whole->first(); i < whole->last(); ++i) {
      const Rigid3 now_from_start = whole->poses[i - whole->first()].inverse() * start_[i];
      for (int k = by_pose_.begin[i]; k < by_pose_.begin[i + 1]; ++k) {
        const int p = problem_.observations[by_pose_.observations[k]].point;
        const bool is_fixed = !problem_.point_is_fixed.empty() && problem_.point_is_fixed[p];
        if (local_[p] < 0 || has_value[local_[p]] || is_fixed) continue;
        whole->points[local_[p]] = now_from_start * problem_.points[p];
        has_value[local_[p]] = 1;
      }
    }
    for (int p : whole->point_ids) local_[p] = -1;
  }

  const BundleProblem& problem_;
  const BundleOptions& options_;
  const HierarchyOptions& hierarchy_;
  ObservationsByPose by_pose_;
  bool with_scale_;
  std::vector<Rigid3> start_;
  std::vector<int> local_;  // by point; -1 between two uses
  BundleAdjuster adjuster_;
  HierarchyResult result_;
};

}  // namespace

HierarchyResult merge_pieces(const BundleProblem& problem, const BundleOptions& options,
                             const HierarchyOptions& hierarchy) {
  return Hierarchy(problem, options, hierarchy).run();
}

}  // namespace raysfm
