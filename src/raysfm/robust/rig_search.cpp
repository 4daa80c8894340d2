#include "raysfm/robust/rig_search.h"

#include <algorithm>
#include <map>

#include "raysfm/geometry/triangulation.h"
#include "raysfm/robust/three_view_sample.h"
#include "raysfm/solvers/generalised_p3p.h"
#include "raysfm/solvers/seventeen_point.h"
#include "raysfm/solvers/translation_scale.h"

namespace raysfm {

using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

// Squared tangent of the angle between a direction and where the point is seen.
double squared_tangent(const Vector3d& direction, const Vector3d& seen) {
  const double along = direction.dot(seen);
  return along > 0 ? std::max(0.0, seen.squaredNorm() - along * along) / (along * along) : 1e9;
}

}  // namespace

struct RigScorer::Frames {
  Matrix3d r1, r2;
  Vector3d t1, t2;
  explicit Frames(const RigMotion& motion)
      : r1(motion.rig1_from_rig0.rotation.toRotationMatrix()),
        r2(motion.rig2_from_rig0.rotation.toRotationMatrix()),
        t1(motion.rig1_from_rig0.translation),
        t2(motion.rig2_from_rig0.translation) {}
};

RigScorer::RigScorer(const RigTable& table, double max_error) : table_(table) {
  // Half the sum of two squared errors, each holding the noise of view 0 as well as its own.
  const double scale = 0.25 / (max_error * max_error);
  matches_.reserve(table.points.size());
  for (const RigTable::Point& point : table.points) {
    const Ray rays[3] = {table.primary(point, 0), table.primary(point, 1), table.primary(point, 2)};
    matches_.push_back({rays[0].origin, rays[0].direction, rays[1].origin, rays[1].direction, rays[2].origin,
                        rays[2].direction, scale * point.weight1, scale * point.weight2});
  }
  inliers_.reserve(table.points.size());
}

// 1 at the limit of an inlier. The point lies on the ray of view 0, at the distance that fits view 2.
double RigScorer::error(const Frames& f, const Match& m) const {
  const Vector3d along2 = f.r2 * m.direction0, from2 = f.r2 * m.origin0 + f.t2 - m.origin2;
  const Vector3d across = m.direction2.cross(from2);
  const double across2 = across.squaredNorm();
  const double rho = across2 > 1e-16 ? std::max(0.0, -m.direction2.cross(along2).dot(across) / across2) : 0.0;
  const double error2 = m.weight2 * squared_tangent(m.direction2, along2 + rho * from2);
  if (error2 >= 1) return error2;
  const Vector3d from1 = f.r1 * m.origin0 + f.t1 - m.origin1;
  return error2 + m.weight1 * squared_tangent(m.direction1, f.r1 * m.direction0 + rho * from1);
}

RansacScore RigScorer::score(const RigMotion& motion, double limit) const {
  const Frames frames(motion);
  return truncated_score(size(), limit, [&](int i) { return error(frames, matches_[i]); });
}

void RigScorer::collect_inliers(const RigMotion& motion, std::vector<int>* inliers) const {
  const Frames frames(motion);
  inliers->clear();
  for (int i = 0; i < size(); ++i) {
    if (error(frames, matches_[i]) < 1) inliers->push_back(i);
  }
}

void RigScorer::refine(RigMotion* motion) {
  constexpr int kMaxPoints = 100;
  constexpr RigRefiner::Options kFew{.max_iterations = 4};
  collect_inliers(*motion, &inliers_);
  thin_out(kMaxPoints, &inliers_);
  refiner_.refine(table_, inliers_, kFew, motion);
}

FivePointRansac::FivePointRansac(const RigTable& table, double max_error)
    : RigScorer(table, max_error), group_of_(table.points.size(), -1) {
  constexpr double kFar = 30;
  std::map<int, std::vector<int>> by_camera;
  for (int i = 0; i < size(); ++i) by_camera[table.points[i].camera].push_back(i);
  by_camera.erase(-1);
  for (auto& [camera, points] : by_camera) {
    if (points.size() < 5) continue;
    Group group;
    for (const int i : points) {
      group_of_[i] = static_cast<int>(groups_.size());
      for (int v = 0; v < 3; ++v) group.centre += table.primary(table.points[i], v).origin;
    }
    group.centre /= 3.0 * static_cast<double>(points.size());
    group.points = std::move(points);
    groups_.push_back(std::move(group));
  }
  for (int k = 0; k < size(); ++k) {
    const RigTable::Point& point = table.points[k];
    for (int i = point.begin; i < point.end; ++i) {
      for (int j = point.begin; j < point.end; ++j) {
        if (table.views[i] != 0 || table.views[j] != 2) continue;
        const bool primary = i == point.primary[0] && j == point.primary[2];
        pairs_.push_back({i, j, primary ? group_of_[k] : -1});
      }
    }
  }
  pairs_outside_.resize(groups_.size());
  for (size_t g = 0; g < groups_.size(); ++g) {
    for (size_t k = 0; k < pairs_.size(); ++k) {
      if (pairs_[k].group != static_cast<int>(g)) pairs_outside_[g].push_back(static_cast<int>(k));
    }
    // One camera alone: what its rays say by not meeting in one centre.
    for (size_t k = 0; k < pairs_.size() && groups_.size() == 1; ++k) {
      pairs_outside_[g].push_back(static_cast<int>(k));
    }
  }
  for (const ObservedRay& ray : table.rays) longest_ = std::max(longest_, kFar * ray.origin.norm());
  votes_.reserve(pairs_.size());
  scratch_.reserve(table.points.size());
}

bool FivePointRansac::sample(Rng& rng, std::array<int, 5>* sample) const {
  const int group = group_of_[rng.index(static_cast<uint32_t>(size()))];
  if (group < 0) return false;
  const std::vector<int>& points = groups_[group].points;
  draw_sample(rng, static_cast<int>(points.size()), sample);
  for (int& i : *sample) i = points[i];
  return true;
}

// Length of the motion of a group's centre, of which rig2_from_rig0 holds the part without. A pair says
// offset / length + slope = 0 up to the error of its rays, so that its vote is for the inverse of the length,
// with the weight |offset|. Where the votes are for none, far more than the origins are apart.
double FivePointRansac::median_scale(const Rigid3& rig2_from_rig0, const Vector3d& unit_direction, int group,
                                     int max_pairs) {
  const std::vector<int>& outside = pairs_outside_[group];
  const Matrix3d rotation = rig2_from_rig0.rotation.toRotationMatrix();
  const int stride = std::max(1, static_cast<int>(outside.size()) / max_pairs);
  votes_.clear();
  double total = 0;
  for (size_t k = 0; k < outside.size(); k += stride) {
    const Pair& pair = pairs_[outside[k]];
    const TranslationScale vote = translation_scale(rotation, rig2_from_rig0.translation, unit_direction,
                                                    table_.ray(pair.ray0), table_.ray(pair.ray2));
    if (!(std::abs(vote.offset) > 1e-12 * longest_)) continue;
    votes_.emplace_back(-vote.slope / vote.offset, std::abs(vote.offset));
    total += std::abs(vote.offset);
  }
  std::sort(votes_.begin(), votes_.end());
  double sum = 0;
  for (const auto& [inverse, weight] : votes_) {
    sum += weight;
    if (sum >= 0.5 * total) return inverse * longest_ > 1 ? 1 / inverse : longest_;
  }
  return longest_;
}

int FivePointRansac::generate(const std::array<int, 5>& sample, std::array<RigMotion, 10>* motions) {
  constexpr int kPairs = 24;
  FiveBearings bearings;
  for (int v = 0; v < 3; ++v) {
    for (int i = 0; i < 5; ++i) bearings[v][i] = table_.primary(table_.points[sample[i]], v).direction;
  }
  std::array<ThreeViewMotion, 10> of_camera;
  const int count = five_point_motions(bearings, &of_camera);
  const int group = group_of_[sample[0]];
  const Vector3d& c = groups_[group].centre;
  for (int k = 0; k < count; ++k) {
    const Rigid3 &cam1 = of_camera[k].cam1_from_cam0, &cam2 = of_camera[k].cam2_from_cam0;
    const Rigid3 turned{cam2.rotation, c - cam2.rotation * c};
    const double scale = median_scale(turned, cam2.translation, group, kPairs);
    (*motions)[k].rig2_from_rig0 = {cam2.rotation, turned.translation + scale * cam2.translation};
    (*motions)[k].rig1_from_rig0 = {cam1.rotation, c - cam1.rotation * c + scale * cam1.translation};
  }
  return count;
}

int FivePointRansac::group_with_most(const std::vector<int>& points) const {
  std::vector<int> counts(groups_.size(), 0);
  for (const int i : points) {
    if (group_of_[i] >= 0) ++counts[group_of_[i]];
  }
  return static_cast<int>(std::max_element(counts.begin(), counts.end()) - counts.begin());
}

// A motion from a sample may fit one camera alone: its scale is taken from the others once it is sure.
void FivePointRansac::refine(RigMotion* motion) {
  RigScorer::refine(motion);
  RigMotion rescaled = *motion;
  if (!rescale(&rescaled)) return;
  RigScorer::refine(&rescaled);
  if (score(rescaled, size()).cost < score(*motion, size()).cost) *motion = rescaled;
}

bool FivePointRansac::rescale(RigMotion* motion) {
  constexpr int kPairs = 200;
  collect_inliers(*motion, &scratch_);
  const int group = group_with_most(scratch_);
  const Vector3d& c = groups_[group].centre;
  Rigid3 &pose1 = motion->rig1_from_rig0, &pose2 = motion->rig2_from_rig0;
  const Vector3d turned1 = c - pose1.rotation * c, turned2 = c - pose2.rotation * c;
  const double length = (pose2.translation - turned2).norm();
  if (!(length > 0)) return false;
  const Vector3d direction = (pose2.translation - turned2) / length;
  const double scale = median_scale({pose2.rotation, turned2}, direction, group, kPairs);
  pose1.translation = turned1 + scale / length * (pose1.translation - turned1);
  pose2.translation = turned2 + scale * direction;
  return true;
}

bool SeventeenPointRansac::sample(Rng& rng, std::array<int, 17>* sample) const {
  draw_sample(rng, size(), sample);
  return true;
}

int SeventeenPointRansac::generate(const std::array<int, 17>& sample,
                                   std::array<RigMotion, 4>* motions) const {
  std::array<std::array<Ray, 17>, 3> rays;
  for (int v = 0; v < 3; ++v) {
    for (int i = 0; i < 17; ++i) rays[v][i] = table_.primary(table_.points[sample[i]], v);
  }
  std::array<Rigid3, 4> poses;
  const int count = seventeen_point(rays[0], rays[2], class_, &poses);
  int found = 0;
  for (int k = 0; k < count; ++k) {
    const Rigid3 rig0_from_rig2 = poses[k].inverse();
    std::array<Vector3d, 17> points;
    std::array<int, 17> in_front;
    int front = 0;
    for (int i = 0; i < 17; ++i) {
      const Ray moved{rig0_from_rig2 * rays[2][i].origin, rig0_from_rig2.rotation * rays[2][i].direction};
      if (triangulate_midpoint(rays[0][i], moved, &points[i])) in_front[front++] = i;
    }
    if (front < 12) continue;
    // Resection of view 1 from three of them, the solution that fits all best.
    std::array<Rigid3, kMaxGeneralisedP3pPoses> resections;
    const std::array<int, 3> three = {in_front[0], in_front[front / 2], in_front[front - 1]};
    const int resection_count = generalised_p3p(
        std::array<Ray, 3>{rays[1][three[0]], rays[1][three[1]], rays[1][three[2]]},
        std::array<Vector3d, 3>{points[three[0]], points[three[1]], points[three[2]]}, &resections);
    double best = std::numeric_limits<double>::infinity();
    for (int r = 0; r < resection_count; ++r) {
      double error = 0;
      for (int i = 0; i < front; ++i) {
        const Ray& ray = rays[1][in_front[i]];
        error +=
            ((resections[r] * points[in_front[i]] - ray.origin).normalized() - ray.direction).squaredNorm();
      }
      if (error < best) best = error, (*motions)[found].rig1_from_rig0 = resections[r];
    }
    if (resection_count == 0) continue;
    (*motions)[found++].rig2_from_rig0 = poses[k];
  }
  return found;
}

}  // namespace raysfm
