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
  RansacScore score{.cost = 0, .inliers = 0};
  for (const Match& match : matches_) {
    const double e = error(frames, match);
    score.inliers += e < 1;
    score.cost += std::min(e, 1.0);
    if (score.cost > limit) return {};
  }
  return score;
}

void RigScorer::collect_inliers(const RigMotion& motion, std::vector<int>* inliers) const {
  const Frames frames(motion);
  inliers->clear();
  for (int i = 0; i < size(); ++i) {
    if (error(frames, matches_[i]) < 1) inliers->push_back(i);
  }
}

void RigScorer::refine(RigMotion* motion) {
  constexpr size_t kMaxPoints = 100;
  constexpr int kIterations = 4;
  collect_inliers(*motion, &inliers_);
  const size_t stride = (inliers_.size() + kMaxPoints - 1) / kMaxPoints;
  if (stride > 1) {
    size_t kept = 0;
    for (size_t i = 0; i < inliers_.size(); i += stride) inliers_[kept++] = inliers_[i];
    inliers_.resize(kept);
  }
  refiner_.refine(table_, inliers_, false, kIterations, motion);
}

FivePlusOneRansac::FivePlusOneRansac(const RigTable& table, double max_error)
    : RigScorer(table, max_error), group_of_(table.points.size(), -1) {
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
}

bool FivePlusOneRansac::sample(Rng& rng, std::array<int, 6>* sample) const {
  constexpr int kTries = 20;
  const auto any = [&] { return static_cast<int>(rng.index(static_cast<uint32_t>(size()))); };
  int group = -1;
  for (int k = 0; k < kTries && group < 0; ++k) group = group_of_[any()];
  if (group < 0) return false;
  const std::vector<int>& points = groups_[group].points;
  std::array<int, 5> five;
  draw_sample(rng, static_cast<int>(points.size()), &five);
  for (int i = 0; i < 5; ++i) (*sample)[i] = points[five[i]];
  // The sixth is of another camera where there is one.
  const bool all_in_group = static_cast<int>(points.size()) == size();
  for (int k = 0; k < kTries; ++k) {
    const int sixth = any();
    if (std::find(sample->begin(), sample->begin() + 5, sixth) != sample->begin() + 5) continue;
    if (!all_in_group && group_of_[sixth] == group) continue;
    (*sample)[5] = sixth;
    return true;
  }
  return false;
}

int FivePlusOneRansac::generate(const std::array<int, 6>& sample, std::array<RigMotion, 10>* motions) const {
  FiveBearings bearings;
  for (int v = 0; v < 3; ++v) {
    for (int i = 0; i < 5; ++i) bearings[v][i] = table_.primary(table_.points[sample[i]], v).direction;
  }
  std::array<ThreeViewMotion, 10> of_camera;
  const int count = five_point_motions(bearings, &of_camera);
  const Vector3d& c = groups_[group_of_[sample[0]]].centre;
  const RigTable::Point& sixth = table_.points[sample[5]];
  const Ray ray0 = table_.primary(sixth, 0), ray2 = table_.primary(sixth, 2);
  for (int k = 0; k < count; ++k) {
    const Rigid3 &cam1 = of_camera[k].cam1_from_cam0, &cam2 = of_camera[k].cam2_from_cam0;
    double scale = 1;
    const Vector3d start = c - cam2.rotation * c;
    const bool solved =
        translation_scale(cam2.rotation.toRotationMatrix(), start, cam2.translation, ray0, ray2, &scale);
    // A scale that is not to be seen comes out with either sign: any will do then.
    if (!solved || !(scale > 0)) scale = 1;
    (*motions)[k].rig2_from_rig0 = {cam2.rotation, start + scale * cam2.translation};
    (*motions)[k].rig1_from_rig0 = {cam1.rotation, c - cam1.rotation * c + scale * cam1.translation};
  }
  return count;
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
