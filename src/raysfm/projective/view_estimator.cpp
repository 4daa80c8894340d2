#include "raysfm/projective/view_estimator.h"

#include <Eigen/Geometry>

#include "raysfm/projective/eight_point.h"
#include "raysfm/projective/projective_resection.h"

namespace raysfm {

bool ViewEstimator::sample(Rng& rng, std::array<int, kSampleSize>* sample) const {
  draw_sample(rng, size(), sample);
  return true;
}

int ViewEstimator::generate(const std::array<int, kSampleSize>& sample,
                            std::array<Model, kMaxModels>* models) {
  return fit(sample, models->data()) ? 1 : 0;
}

double ViewEstimator::error2(const Model& model, int i) const {
  return squared_error(model, points_[i], pixels_[i]);
}

RansacScore ViewEstimator::score(const Model& model, double limit) const {
  return truncated_score(size(), limit, [&](int i) { return error2(model, i) / max_error2_; });
}

void ViewEstimator::refine(Model* model) {
  constexpr int kRounds = 3;
  for (int round = 0; round < kRounds; ++round) {
    kept_.clear();
    for (int i = 0; i < size(); ++i) {
      if (error2(*model, i) < max_error2_) kept_.push_back(i);
    }
    Model better;
    if (!fit(kept_, &better)) return;
    *model = better;
  }
}

bool ViewEstimator::fit(std::span<const int> chosen, Model* model) {
  in_plane_.clear(), in_space_.clear(), seen_.clear();
  for (const int i : chosen) {
    in_plane_.push_back(points_[i].head<2>());
    in_space_.push_back(points_[i]);
    seen_.push_back(pixels_[i]);
  }
  if (!planar_) return view_from_points(in_space_, seen_, model);
  Eigen::Matrix3d homography;
  if (!homography_from_points(in_plane_, seen_, &homography)) return false;
  *model << homography.col(0), homography.col(1), Eigen::Vector3d::Zero(), homography.col(2);
  return true;
}

}  // namespace raysfm
