#pragma once

#include <Eigen/Core>
#include <array>
#include <span>

#include "raysfm/core/random.h"
#include "raysfm/robust/ransac.h"

namespace raysfm {

// Essential matrix of two views from five matches of unit bearings; the estimator of ransac(). An inlier's
// bearings are off the epipolar planes of one another by at most `max_error` radians, to the first order
// (Sampson's distance on the sphere). The spans have one length.
class EssentialRansac {
 public:
  using Model = Eigen::Matrix3d;  // bearing1^T E bearing0 = 0
  static constexpr int kSampleSize = 5;
  static constexpr int kMaxModels = 10;

  EssentialRansac(std::span<const Eigen::Vector3d> bearings0, std::span<const Eigen::Vector3d> bearings1,
                  double max_error)
      : bearings0_(bearings0), bearings1_(bearings1), max_error2_(max_error * max_error) {}

  int size() const { return static_cast<int>(bearings0_.size()); }
  bool sample(Rng& rng, std::array<int, kSampleSize>* sample) const {
    draw_sample(rng, size(), sample);
    return true;
  }
  int generate(const std::array<int, kSampleSize>& sample,
               std::array<Eigen::Matrix3d, kMaxModels>* models) const;
  RansacScore score(const Eigen::Matrix3d& essential, double limit) const;
  // Least squares over the inliers, where there are enough of them.
  void refine(Eigen::Matrix3d* essential) const;
  bool is_inlier(const Eigen::Matrix3d& essential, int match) const { return share2(essential, match) < 1; }

 private:
  // (error / max_error)^2.
  double share2(const Eigen::Matrix3d& essential, int match) const;

  std::span<const Eigen::Vector3d> bearings0_, bearings1_;
  double max_error2_;
};

}  // namespace raysfm
