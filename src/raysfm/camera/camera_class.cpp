#include "raysfm/camera/camera_class.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <vector>

namespace raysfm {
namespace {

// Rays of a grid of pixels over one camera, in the rig's frame.
std::vector<Ray> sample_rays(const Camera& camera) {
  constexpr int kGrid = 16;
  std::vector<Ray> rays;
  for (int i = 0; i < kGrid * kGrid; ++i) {
    const Eigen::Vector2d pixel((i % kGrid + 0.5) * camera.width / kGrid - 0.5,
                                (i / kGrid + 0.5) * camera.height / kGrid - 0.5);
    Ray ray;
    if (!camera.ray(pixel, &ray)) continue;
    rays.push_back({camera.rig_from_cam * ray.origin, camera.rig_from_cam.rotation * ray.direction});
  }
  return rays;
}

// The point of least sum of squared distances to the lines of the rays, and the root mean square of these
// distances. False for rays that are all parallel.
bool common_point(const std::vector<Ray>& rays, Eigen::Vector3d* point, double* rms_distance) {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (const Ray& ray : rays) {
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - ray.direction * ray.direction.transpose();
    normal += across;
    right += across * ray.origin;
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(normal);
  if (!(eigen.eigenvalues()[0] > 1e-9 * eigen.eigenvalues()[2])) return false;
  *point =
      eigen.eigenvectors() * (eigen.eigenvectors().transpose() * right).cwiseQuotient(eigen.eigenvalues());
  double sum = 0;
  for (const Ray& ray : rays) sum += ray.direction.cross(ray.origin - *point).squaredNorm();
  *rms_distance = std::sqrt(sum / static_cast<double>(rays.size()));
  return true;
}

}  // namespace

std::string_view to_string(CameraClass camera_class) {
  switch (camera_class) {
    case CameraClass::kCentral:
      return "central";
    case CameraClass::kAxial:
      return "axial";
    case CameraClass::kNonAxial:
      return "non-axial";
    case CameraClass::kNonCentral:
      return "non-central";
  }
  return "unknown";
}

CameraClass camera_class(const Rig& rig) {
  // Origins closer than this share of the rig's or the camera's own size are one.
  constexpr double kRelativeTolerance = 1e-6;
  std::vector<Eigen::Vector3d> centres;
  for (const Camera& camera : rig.cameras) {
    const std::vector<Ray> rays = sample_rays(camera);
    if (rays.empty()) continue;
    double spread = 0, rms_distance = 0;
    for (const Ray& ray : rays) spread = std::max(spread, (ray.origin - rays[0].origin).norm());
    if (spread == 0) {  // as for every central model
      centres.push_back(rays[0].origin);
      continue;
    }
    Eigen::Vector3d centre;
    if (!common_point(rays, &centre, &rms_distance) || rms_distance > kRelativeTolerance * spread) {
      return CameraClass::kNonCentral;
    }
    centres.push_back(centre);
  }
  double size = 0, off_line = 0, reach = 0;
  Eigen::Vector3d axis = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& centre : centres) {
    reach = std::max(reach, centre.norm());
    if (const Eigen::Vector3d d = centre - centres[0]; d.norm() > size) {
      size = d.norm();
      axis = d / size;
    }
  }
  if (size <= 1e-9 * std::max(reach, 1e-3)) return CameraClass::kCentral;
  for (const Eigen::Vector3d& centre : centres) {
    off_line = std::max(off_line, axis.cross(centre - centres[0]).norm());
  }
  return off_line <= kRelativeTolerance * size ? CameraClass::kAxial : CameraClass::kNonAxial;
}

}  // namespace raysfm
