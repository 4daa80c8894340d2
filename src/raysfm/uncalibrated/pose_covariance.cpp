#include "raysfm/uncalibrated/pose_covariance.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <cmath>
#include <limits>

#include "raysfm/geometry/pose.h"

namespace raysfm {
namespace {

using Matrix9d = Eigen::Matrix<double, 9, 9>;

// Standard deviation of a principal point that is not known, as a share of the image's larger side.
constexpr double kPrincipalPoint = 0.03;

struct Sums {
  Matrix9d hessian = Matrix9d::Zero();  // pose, log focal length, principal point
  double square = 0;
  int count = 0;
};

void add(const Rigid3& cam_from_world, const Lens& lens, const RadialDistortion& radial,
         const Eigen::Vector3d& point, const Eigen::Vector2d& pixel, Sums* sums) {
  const Eigen::Vector3d x = cam_from_world * point;
  const Eigen::Vector2d m = x.hnormalized(), seen = radial(m);
  Eigen::Matrix<double, 2, 3> by_point;
  by_point << 1, 0, -m.x(), 0, 1, -m.y();
  by_point = lens.matrix().topLeftCorner<2, 2>() * radial.jacobian(m) * by_point / x.z();
  Eigen::Matrix<double, 2, 9> jacobian;
  jacobian.leftCols<3>() = by_point;
  for (int c = 0; c < 3; ++c) jacobian.col(3 + c) = by_point * Eigen::Vector3d::Unit(c).cross(x);
  jacobian.col(6) = Eigen::Vector2d(lens.fx * seen.x(), lens.fy * seen.y());
  jacobian.rightCols<2>().setIdentity();
  sums->hessian.noalias() += jacobian.transpose() * jacobian;
  sums->square += (lens.pixel(seen) - pixel).squaredNorm();
  ++sums->count;
}

template <int kUnknowns>
Matrix6d covariance(const Sums& sums, double principal_point_sigma) {
  Eigen::Matrix<double, kUnknowns, kUnknowns> hessian =
      sums.hessian.template topLeftCorner<kUnknowns, kUnknowns>();
  const int freedom = 2 * sums.count - kUnknowns;
  const double variance = freedom > 0 ? sums.square / freedom : 0;
  if constexpr (kUnknowns > 6)
    hessian.diagonal().template tail<2>().array() += variance / std::pow(principal_point_sigma, 2);
  const Eigen::LDLT<Eigen::Matrix<double, kUnknowns, kUnknowns>> factor(hessian);
  const double limit = 1e-14 * factor.vectorD().maxCoeff();
  if (freedom <= 0 || !(factor.vectorD().minCoeff() > limit)) {
    return Matrix6d::Constant(std::numeric_limits<double>::infinity());
  }
  const Eigen::Matrix<double, kUnknowns, kUnknowns> inverse =
      factor.solve(Eigen::Matrix<double, kUnknowns, kUnknowns>::Identity());
  return variance * inverse.template topLeftCorner<6, 6>();
}

}  // namespace

std::vector<Matrix6d> pose_covariances(const PointTracks& tracks, const UncalibratedReconstruction& found) {
  std::vector<Sums> sums(tracks.image_count);
  for (int k = 0; k < tracks.size(); ++k) {
    const int j = tracks.image[k];
    if (!found.inlier[k] || !found.image_posed[j]) continue;
    add(found.scene.cam_from_world[j], found.scene.lenses[j], found.radial,
        found.scene.points[tracks.point[k]], tracks.pixel[k], &sums[j]);
  }
  const double sigma = kPrincipalPoint * tracks.image_size.maxCoeff();
  std::vector<Matrix6d> result(tracks.image_count, Matrix6d::Zero());
  for (int j = 0; j < tracks.image_count; ++j) {
    if (!found.image_posed[j]) continue;
    result[j] = found.zooming ? covariance<9>(sums[j], sigma) : covariance<6>(sums[j], sigma);
  }
  return result;
}

}  // namespace raysfm
