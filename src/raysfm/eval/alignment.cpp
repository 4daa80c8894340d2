#include "raysfm/eval/alignment.h"

#include <Eigen/Geometry>
#include <cmath>

namespace raysfm {

std::string_view alignment_name(Alignment alignment) {
  switch (alignment) {
    case Alignment::kSim3:
      return "sim3";
    case Alignment::kSe3:
      return "se3";
    case Alignment::kNone:
      return "none";
  }
  return "none";
}

Similarity3 align_points(const Eigen::Matrix3Xd& estimate, const Eigen::Matrix3Xd& truth,
                         Alignment alignment) {
  if (alignment == Alignment::kNone) return {};
  const Eigen::Vector3d mean = estimate.rowwise().mean();
  const double spread = (estimate.colwise() - mean).cwiseAbs().maxCoeff();
  if (spread <= 1e-12 * (1.0 + mean.cwiseAbs().maxCoeff())) {
    return {1.0, Eigen::Quaterniond::Identity(), truth.rowwise().mean() - mean};
  }
  const Eigen::Matrix4d transform = Eigen::umeyama(estimate, truth, alignment == Alignment::kSim3);
  Similarity3 truth_from_estimate;
  // umeyama() returns s R; the scale is the length of any column.
  truth_from_estimate.scale = alignment == Alignment::kSim3 ? transform.block<3, 1>(0, 0).norm() : 1.0;
  if (truth_from_estimate.scale > 0) {
    const Eigen::Matrix3d rotation = transform.topLeftCorner<3, 3>() / truth_from_estimate.scale;
    truth_from_estimate.rotation = Eigen::Quaterniond(rotation).normalized();
  }
  truth_from_estimate.translation = transform.topRightCorner<3, 1>();
  return truth_from_estimate;
}

Rigid3 transform_pose(const Similarity3& b_from_a, const Rigid3& a_from_cam) {
  return {(b_from_a.rotation * a_from_cam.rotation).normalized(), b_from_a * a_from_cam.translation};
}

}  // namespace raysfm
