#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <map>
#include <numbers>
#include <vector>

#include "raysfm/camera/camera.h"
#include "raysfm/core/random.h"
#include "raysfm/geometry/similarity.h"
#include "raysfm/places/map_fusion.h"
#include "raysfm/scene/map.h"

namespace raysfm::test {

struct LongDriveSettings {
  int keyframes = 1000;
  int round = 900;     // key frames of one round
  int points = 250;    // followed at a time
  double life = 7;     // key frames for which a point is followed, the mean
  double again = 0.5;  // part of the points that a later round sees too
  double noise_px = 0.4;
  double turn_drift = 5e-4, scale_drift = 1e-3;  // standard deviations for each key frame: radians, logarithm
  uint64_t seed = 1;
};

// A car that goes round and round a block, a metre from key frame to key frame, and the map that an odometry
// makes of what its camera sees when direction and scale drift: points of a later round are others than those
// of the rounds before, though they are the same.
struct LongDrive {
  Rig rig;
  std::vector<Rigid3> truth;  // rig_from_world
  Map map;
  std::vector<std::vector<SamePoint>> same_points;  // that begin at a key frame, `there` of an earlier round
};

inline Rigid3 pose_on_drive(int keyframe, const LongDriveSettings& settings) {
  const double angle = 2 * std::numbers::pi * keyframe / settings.round;
  const double radius = settings.round / (2 * std::numbers::pi) + 0.4 * (keyframe / settings.round);
  const Eigen::Vector3d center(radius * std::cos(angle), std::sin(5 * angle), radius * std::sin(angle));
  Eigen::Matrix3d world_from_rig;
  world_from_rig.col(2) << -std::sin(angle), 0, std::cos(angle);
  world_from_rig.col(1) << 0, 1, 0;
  world_from_rig.col(0) = world_from_rig.col(1).cross(world_from_rig.col(2));
  return Rigid3{Eigen::Quaterniond(world_from_rig), center}.inverse();
}

class LongDriveMaker {
 public:
  explicit LongDriveMaker(const LongDriveSettings& settings) : settings_(settings), rng_(settings.seed) {
    Camera camera;
    camera.model = Pinhole{700, 700, 600, 190};
    camera.width = 1201, camera.height = 381;
    drive_.rig.cameras.push_back(camera);
    drive_.same_points.resize(settings.keyframes);
  }

  LongDrive make() {
    for (int k = 0; k < settings_.keyframes; ++k) {
      add_keyframe(k);
      see(k);
    }
    return std::move(drive_);
  }

 private:
  struct Followed {
    int track;
    Eigen::Vector3d point;  // in the true world
  };

  Eigen::Vector3d normal() { return {rng_.normal(), rng_.normal(), rng_.normal()}; }

  void add_keyframe(int k) {
    drive_.truth.push_back(pose_on_drive(k, settings_));
    if (k == 0) {
      node_ = similarity_of(drive_.truth[0]);
    } else {
      const Similarity3 drift{std::exp(settings_.scale_drift * rng_.normal()),
                              exp_so3(settings_.turn_drift * normal()), Eigen::Vector3d::Zero()};
      node_ = drift * similarity_of(drive_.truth[k] * drive_.truth[k - 1].inverse()) * node_;
    }
    MapKeyFrame& keyframe = drive_.map.keyframes.emplace_back();
    keyframe.frame = 3 * k;
    keyframe.rig_from_world = {node_.rotation, node_.translation / node_.scale};
  }

  // Tracks that go on, then new ones: points of earlier rounds first.
  void see(int k) {
    std::vector<Followed> kept;
    for (const Followed& f : followed_) {
      if (rng_.uniform() > 1 / settings_.life && observe(k, f)) kept.push_back(f);
    }
    followed_ = std::move(kept);
    std::vector<std::pair<int, Eigen::Vector3d>>& known = begun_[k % settings_.round];
    const size_t earlier = known.size();
    for (size_t i = 0; i < earlier && is_short(); ++i) {
      if (rng_.uniform() > settings_.again) continue;
      const auto [there, point] = known[i];
      const int here = begin(k, point);
      if (here >= 0) drive_.same_points[k].push_back({here, there});
    }
    while (is_short()) {
      const double depth = rng_.uniform(5, 45);
      const Eigen::Vector3d in_rig(rng_.uniform(-0.8, 0.8) * depth, rng_.uniform(-0.25, 0.25) * depth, depth);
      const Eigen::Vector3d point = drive_.truth[k].inverse() * in_rig;
      const int track = begin(k, point);
      if (track >= 0) known.push_back({track, point});
    }
  }

  bool is_short() const { return static_cast<int>(followed_.size()) < settings_.points; }

  int begin(int k, const Eigen::Vector3d& point) {
    const int track = drive_.map.new_track();
    if (!observe(k, {track, point})) {
      drive_.map.free_track(track);
      return -1;
    }
    Track& t = drive_.map.tracks[track];
    t.triangulated = t.had_position = true;
    const Eigen::Vector3d in_map = (drive_.truth[k] * point) / node_.scale * std::exp(0.02 * rng_.normal());
    t.position = drive_.map.keyframes[k].rig_from_world.inverse() * in_map;
    followed_.push_back({track, point});
    return track;
  }

  bool observe(int k, const Followed& f) {
    const Camera& camera = drive_.rig.cameras[0];
    Eigen::Vector2d pixel;
    if (!camera.project(drive_.truth[k] * f.point, &pixel) || !camera.contains(pixel)) return false;
    pixel += settings_.noise_px * normal().head<2>();
    drive_.map.observe(f.track, k, drive_.map.keyframes[k].add(0, pixel.cast<float>(), 0, f.track));
    return true;
  }

  LongDriveSettings settings_;
  Rng rng_;
  LongDrive drive_;
  Similarity3 node_;
  std::vector<Followed> followed_;
  std::map<int, std::vector<std::pair<int, Eigen::Vector3d>>> begun_;  // by key frame of the round
};

inline LongDrive long_drive(const LongDriveSettings& settings) {
  return LongDriveMaker(settings).make();
}

// Lengths of the truth in those of the map about a key frame.
inline double unit_at(const LongDrive& drive, int keyframe) {
  const int a = std::max(keyframe - 5, 0),
            b = std::min<int>(a + 10, static_cast<int>(drive.truth.size()) - 1);
  const auto step = [&](const Rigid3& from, const Rigid3& to) {
    return (from.inverse().translation - to.inverse().translation).norm();
  };
  return step(drive.truth[a], drive.truth[b]) /
         step(drive.map.keyframes[a].rig_from_world, drive.map.keyframes[b].rig_from_world);
}

// Root of the mean square distance of the key frames from where they are, after the similarity that fits
// best.
inline double position_error(const LongDrive& drive) {
  const auto count = static_cast<Eigen::Index>(drive.truth.size());
  Eigen::Matrix3Xd found(3, count), truth(3, count);
  for (Eigen::Index k = 0; k < count; ++k) {
    found.col(k) = drive.map.keyframes[k].rig_from_world.inverse().translation;
    truth.col(k) = drive.truth[k].inverse().translation;
  }
  const Eigen::Matrix4d fit = Eigen::umeyama(found, truth, true);
  const Eigen::Matrix3Xd apart =
      (fit.topLeftCorner<3, 3>() * found).colwise() + fit.topRightCorner<3, 1>() - truth;
  return std::sqrt(apart.squaredNorm() / static_cast<double>(count));
}

}  // namespace raysfm::test
