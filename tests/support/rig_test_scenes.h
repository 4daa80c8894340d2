#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "raysfm/core/random.h"
#include "raysfm/robust/generic_start.h"
#include "support/random_vectors.h"

// Three views of made-up rigs with known motion, for tests and benchmarks of the generic start.
namespace raysfm::rig_scenes {

using testing_support::normal_vector;

enum class Kind {
  kCentral,      // one pinhole, not at the rig's origin
  kStereo,       // two parallel pinholes 0.5 apart, each matches for itself: axial
  kStereoCross,  // the same, half the points seen by both in every view
  kRing3,        // pinholes on a circle of radius 0.3, looking outwards: non-axial
  kRing4,
  kMirror,  // one panoramic camera whose rays start up to 0.1 from the centre
};
enum class Motion { kForward, kSideways, kRotation, kPureTranslation };

inline constexpr double kFocal = 500;  // pixels per radian

struct Settings {
  Kind kind = Kind::kRing3;
  Motion motion = Motion::kForward;
  int points = 300;
  double noise_px = 0.5;
  double outliers = 0;    // share of the points that are wrong in views 1 and 2
  double main_share = 0;  // share of the points in camera 0; 0: even
};

struct Scene {
  Rigid3 rig1_from_rig0, rig2_from_rig0;
  std::vector<Eigen::Vector3d> points_in_rig0;
  std::vector<uint8_t> outlier;  // of each point
  std::vector<ObservedRay> rays;
  std::vector<int> points, views, cameras;
  Eigen::Vector3d centre_in_rig;  // of camera 0

  RigMatches matches() const {
    return {static_cast<int>(points_in_rig0.size()), rays, points, views, cameras};
  }
};

inline std::vector<Rigid3> rig_from_cams(Kind kind) {
  switch (kind) {
    case Kind::kCentral:
      return {{Eigen::Quaterniond::Identity(), {0.2, -0.1, 0.3}}};
    case Kind::kStereo:
    case Kind::kStereoCross:
      return {{}, {Eigen::Quaterniond::Identity(), {0.5, 0, 0}}};
    case Kind::kRing3:
    case Kind::kRing4: {
      std::vector<Rigid3> cams;
      const int count = kind == Kind::kRing3 ? 3 : 4;
      for (int i = 0; i < count; ++i) {
        const Eigen::Quaterniond turn = exp_so3({0, 2 * M_PI * i / count, 0});
        cams.push_back({turn, turn * Eigen::Vector3d(0, 0.05 * (i % 2), 0.3)});
      }
      return cams;
    }
    case Kind::kMirror:
      break;
  }
  return {{}};
}

inline std::array<Rigid3, 2> motion_of(Motion motion, Rng& rng) {
  const Eigen::Vector3d axis = normal_vector(rng).normalized();
  std::array<Rigid3, 2> poses;
  for (int v = 1; v < 3; ++v) {
    Eigen::Vector3d t(0, 0, 0.5 * v);
    double angle = 0.08 * v;
    if (motion == Motion::kSideways) t = {0.5 * v, 0, 0};
    if (motion == Motion::kRotation) t = {0.1 * v, 0, 0.1 * v}, angle = 0.2 * v;
    if (motion == Motion::kPureTranslation) angle = 0;
    poses[v - 1] = Rigid3{exp_so3(angle * axis), t + 0.03 * normal_vector(rng)}.inverse();
  }
  return poses;
}

// Where the mirror's ray of a direction starts.
inline Eigen::Vector3d mirror_origin(const Eigen::Vector3d& direction) {
  return {0.1 * direction.x(), 0.1 * direction.y() * std::abs(direction.y()), 0.1 * direction.z()};
}

// The ray along which a camera sees a point of the rig's frame, `noise` radians off on either axis.
inline ObservedRay observe(Kind kind, const Rigid3& rig_from_cam, const Eigen::Vector3d& in_rig, double noise,
                           Rng& rng) {
  ObservedRay ray;
  ray.origin = rig_from_cam.translation;
  ray.direction = (in_rig - ray.origin).normalized();
  for (int k = 0; k < 60 && kind == Kind::kMirror; ++k) {
    ray.origin = mirror_origin(ray.direction);
    ray.direction = (in_rig - ray.origin).normalized();
  }
  ray.direction = (ray.direction + noise * normal_vector(rng)).normalized();
  if (kind == Kind::kMirror) ray.origin = mirror_origin(ray.direction);
  ray.tangents.row(0) = kFocal * ray.direction.unitOrthogonal();
  ray.tangents.row(1) = ray.direction.cross(Eigen::Vector3d(ray.tangents.row(0)));
  return ray;
}

inline Scene make_scene(const Settings& settings, Rng& rng) {
  Scene scene;
  const std::vector<Rigid3> cams = rig_from_cams(settings.kind);
  const int camera_count = static_cast<int>(cams.size());
  scene.centre_in_rig = cams[0].translation;
  const auto [rig1, rig2] = motion_of(settings.motion, rng);
  scene.rig1_from_rig0 = rig1, scene.rig2_from_rig0 = rig2;
  const std::array<Rigid3, 3> poses = {Rigid3{}, rig1, rig2};
  const double noise = settings.noise_px / kFocal;
  while (static_cast<int>(scene.points_in_rig0.size()) < settings.points) {
    const int index = static_cast<int>(scene.points_in_rig0.size());
    const bool main = index < settings.main_share * settings.points;
    const int c = main ? 0 : static_cast<int>(rng.index(static_cast<uint32_t>(camera_count)));
    const bool mirror = settings.kind == Kind::kMirror;
    const Eigen::Vector3d in_cam = mirror
                                       ? Eigen::Vector3d(normal_vector(rng).normalized())
                                       : Eigen::Vector3d(rng.uniform(-0.8, 0.8), rng.uniform(-0.6, 0.6), 1);
    const Eigen::Vector3d in_rig0 = rig1.inverse() * (cams[c] * Eigen::Vector3d(rng.uniform(3, 15) * in_cam));
    const bool seen = mirror || std::all_of(poses.begin(), poses.end(), [&](const Rigid3& pose) {
                        return (cams[c].inverse() * (pose * in_rig0)).z() > 0.5;
                      });
    if (!seen) continue;
    scene.points_in_rig0.push_back(in_rig0);
    // Spread over the cameras: the first points are the main camera's.
    const bool outlier = (index * 7919) % 1000 < 1000 * settings.outliers;
    scene.outlier.push_back(outlier);
    const bool both = settings.kind == Kind::kStereoCross && index % 2 == 0;
    for (int v = 0; v < 3; ++v) {
      for (int k = 0; k < camera_count; ++k) {
        if (k != c && !both) continue;
        const double wrong = outlier && v > 0 ? 0.1 : noise;
        scene.rays.push_back(observe(settings.kind, cams[k], poses[v] * in_rig0, wrong, rng));
        scene.points.push_back(index);
        scene.views.push_back(v);
        scene.cameras.push_back(k);
      }
    }
  }
  return scene;
}

struct MotionError {
  double rotation = 0;   // radians, the larger of views 1 and 2
  double direction = 0;  // radians, of the motion of camera 0's centre to view 2
  double scale = 1;      // of this motion over the true one
};

inline MotionError motion_error(const Scene& scene, const Rigid3& rig1_from_rig0,
                                const Rigid3& rig2_from_rig0) {
  MotionError error;
  for (const auto& [a, b] :
       {std::pair(rig1_from_rig0, scene.rig1_from_rig0), std::pair(rig2_from_rig0, scene.rig2_from_rig0)}) {
    error.rotation = std::max(error.rotation, rotation_angle(a.rotation * b.rotation.conjugate()));
  }
  const Eigen::Vector3d& c = scene.centre_in_rig;
  const Eigen::Vector3d found = rig2_from_rig0.inverse() * c - c,
                        truth = scene.rig2_from_rig0.inverse() * c - c;
  error.direction = std::atan2(found.cross(truth).norm(), found.dot(truth));
  error.scale = found.norm() / truth.norm();
  return error;
}

}  // namespace raysfm::rig_scenes
