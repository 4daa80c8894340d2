#pragma once

#include <Eigen/Core>
#include <array>
#include <span>
#include <vector>

#include "raysfm/projective/optimal_triangulation.h"
#include "raysfm/robust/ransac.h"

namespace raysfm {

// An estimator of ransac() for the 3x4 view that takes points to pixels, which are best near unit size.
class ViewEstimator {
 public:
  using Model = Matrix34d;
  static constexpr int kSampleSize = 6, kMaxModels = 1;

  // Points (4 numbers) and pixels, as many, must outlive the object; `max_error` in the unit of the pixels.
  // `planar`: the third number of the points is not looked at, and the third column of the view is 0.
  ViewEstimator(const std::vector<Eigen::Vector4d>& points, const std::vector<Eigen::Vector2d>& pixels,
                bool planar, double max_error)
      : points_(points), pixels_(pixels), planar_(planar), max_error2_(max_error * max_error) {}

  int size() const { return static_cast<int>(points_.size()); }
  bool sample(Rng& rng, std::array<int, kSampleSize>* sample) const;
  int generate(const std::array<int, kSampleSize>& sample, std::array<Model, kMaxModels>* models);
  RansacScore score(const Model& model, double limit) const;
  void refine(Model* model);
  // Squared distance of a point's image from its pixel.
  double error2(const Model& model, int i) const;

 private:
  bool fit(std::span<const int> chosen, Model* model);

  const std::vector<Eigen::Vector4d>& points_;
  const std::vector<Eigen::Vector2d>& pixels_;
  const bool planar_;
  const double max_error2_;
  std::vector<int> kept_;
  std::vector<Eigen::Vector4d> in_space_;
  std::vector<Eigen::Vector2d> in_plane_, seen_;
};

// The same of any view, point and pixel.
inline double squared_error(const Matrix34d& view, const Eigen::Vector4d& point,
                            const Eigen::Vector2d& pixel) {
  return ((view * point).hnormalized() - pixel).squaredNorm();
}

}  // namespace raysfm
