#pragma once

#include <Eigen/Core>
#include <array>
#include <span>

#include "raysfm/core/random.h"
#include "raysfm/robust/ransac.h"

namespace raysfm {

// Rotation between two views from two matches of unit bearings; the estimator of ransac(). An inlier is off
// by at most `max_error` radians.
class RotationRansac {
 public:
  using Model = Eigen::Matrix3d;  // cam2_from_cam0
  static constexpr int kSampleSize = 2;
  static constexpr int kMaxModels = 1;

  RotationRansac(std::span<const Eigen::Vector3d> bearings0, std::span<const Eigen::Vector3d> bearings2,
                 double max_error)
      : bearings0_(bearings0), bearings2_(bearings2), max_error2_(max_error * max_error) {}

  int size() const { return static_cast<int>(bearings0_.size()); }
  bool sample(Rng& rng, std::array<int, 2>* sample) const {
    draw_sample(rng, size(), sample);
    return true;
  }
  int generate(const std::array<int, 2>& sample, std::array<Eigen::Matrix3d, 1>* models) const;
  RansacScore score(const Eigen::Matrix3d& rotation, double limit) const;
  void refine(Eigen::Matrix3d* rotation) const;

 private:
  std::span<const Eigen::Vector3d> bearings0_, bearings2_;
  double max_error2_;
};

// How many matches a rotation explains, where it explains `least` or more; else as many as a search for such
// a one comes upon.
int rotation_inliers(std::span<const Eigen::Vector3d> bearings0, std::span<const Eigen::Vector3d> bearings2,
                     double max_error, double least, RansacOptions options);

}  // namespace raysfm
