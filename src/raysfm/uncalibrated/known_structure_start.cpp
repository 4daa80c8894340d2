#include "raysfm/uncalibrated/known_structure_start.h"

#include <Eigen/Dense>
#include <cmath>

#include "raysfm/core/median.h"
#include "raysfm/projective/absolute_quadric.h"
#include "raysfm/projective/view_estimator.h"
#include "raysfm/projective/view_pair.h"
#include "raysfm/uncalibrated/known_structure.h"

namespace raysfm {
namespace {

constexpr double kUsualFocal = 2.0;                 // in units of half the image's larger side
constexpr double kMinFocal = 0.1, kMaxFocal = 100;  // the same
constexpr double kFlat = 1e-3, kThin = 1e-6;        // thickness and breadth, as shares of the length

// Points of the structure about their mean along its principal axes, the last one the thinnest.
struct Frame {
  Rigid3 frame_from_world;
  double scale = 1;  // of the length
  bool planar = false, line = false;
};

Frame principal_frame(std::span<const Eigen::Vector3d> points) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& x : points) mean += x / double(points.size());
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& x : points)
    covariance += (x - mean) * (x - mean).transpose() / double(points.size());
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(covariance);
  const Eigen::Vector3d extent = eigen.eigenvalues().cwiseMax(0).cwiseSqrt();  // ascending
  Eigen::Matrix3d axes;                                                        // rows: longest first
  for (int k = 0; k < 2; ++k) axes.row(k) = eigen.eigenvectors().col(2 - k).transpose();
  axes.row(2) = axes.row(0).cross(axes.row(1));
  Frame frame;
  frame.frame_from_world.rotation = Eigen::Quaterniond(axes).normalized();
  frame.frame_from_world.translation = -(frame.frame_from_world.rotation * mean);
  frame.scale = extent[2] > 0 ? extent[2] : 1;
  frame.planar = extent[0] < kFlat * extent[2];
  frame.line = !(extent[1] > kThin * extent[2]);
  return frame;
}

// Sums of the conditions on 1/f^2 that the images of two right angles of a plane are (Zhang 2000, equations 3
// and 4).
struct FocalSums {
  double ab = 0, aa = 0;

  void add(const Matrix34d& map) {
    const Eigen::Vector3d h1 = map.col(0), h2 = map.col(1);
    const double unit = h1.head<2>().squaredNorm() + h2.head<2>().squaredNorm();
    const auto add = [&](double a, double b) { ab += a * b / (unit * unit), aa += a * a / (unit * unit); };
    add(h1.head<2>().dot(h2.head<2>()), -h1.z() * h2.z());
    add(0.5 * (h1.head<2>().squaredNorm() - h2.head<2>().squaredNorm()),
        0.5 * (h2.z() * h2.z() - h1.z() * h1.z()));
  }
  // 0 where the conditions do not tell.
  double focal() const { return aa > 0 && ab > 0 ? std::sqrt(aa / ab) : 0; }
};

double view_focal(const Matrix34d& map) {
  Lens lens;
  Rigid3 pose;
  return decompose_view(map, &lens, &pose) ? std::sqrt(lens.fx * lens.fy) : 0;
}

double usable(double focal, double otherwise) {
  return focal >= kMinFocal && focal <= kMaxFocal ? focal : otherwise;
}

std::vector<double> focal_lengths(const std::vector<Matrix34d>& maps, const std::vector<uint8_t>& posed,
                                  bool planar, bool equal) {
  FocalSums all;
  std::vector<double> found, focal(maps.size(), 0);
  for (size_t j = 0; j < maps.size(); ++j) {
    if (!posed[j]) continue;
    FocalSums own;
    own.add(maps[j]);
    all.add(maps[j]);
    focal[j] = usable(planar ? own.focal() : view_focal(maps[j]), 0);
    if (focal[j] > 0) found.push_back(focal[j]);
  }
  const double median = found.empty() ? kUsualFocal : median_of(&found);
  const double common = usable(planar ? all.focal() : median, median);
  for (double& f : focal) f = equal || f == 0 ? common : f;
  return focal;
}

// The pose that a map is with this focal length, nearest rotation.
Rigid3 pose_of_map(const Matrix34d& map, double focal, bool planar) {
  Matrix34d m = Eigen::Vector3d(1 / focal, 1 / focal, 1).asDiagonal() * map;
  m *= m(2, 3) < 0 ? -1 : 1;  // the middle of the points is in front
  if (planar) m.col(2) = m.col(0).cross(m.col(1)) * 2 / (m.col(0).norm() + m.col(1).norm());
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(m.leftCols<3>(), Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d u = svd.matrixU();
  if ((u * svd.matrixV().transpose()).determinant() < 0) u.col(2) = -u.col(2);
  const Eigen::Matrix3d rotation = u * svd.matrixV().transpose();
  const double scale = planar ? svd.singularValues().head<2>().mean() : svd.singularValues().mean();
  return {Eigen::Quaterniond(rotation).normalized(), m.col(3) / scale};
}

}  // namespace

std::optional<KnownStructureStart> known_structure_start(const PointTracks& tracks,
                                                         std::span<const Eigen::Vector3d> points,
                                                         const KnownStructureStartOptions& options) {
  const Frame frame = principal_frame(points);
  if (frame.line) return std::nullopt;
  const double unit = 0.5 * tracks.image_size.maxCoeff();
  const ImageObservations observations(tracks);
  KnownStructureStart start;
  start.image_posed.assign(tracks.image_count, 0);
  start.inlier.assign(tracks.size(), 0);
  std::vector<Matrix34d> maps(tracks.image_count, Matrix34d::Zero());
  for (int j = 0; j < tracks.image_count; ++j) {
    std::vector<Eigen::Vector4d> in_frame;
    std::vector<Eigen::Vector2d> pixels;
    for (const int* k = observations.begin(j); k != observations.end(j); ++k) {
      const Eigen::Vector3d x = frame.frame_from_world * points[tracks.point[*k]] / frame.scale;
      in_frame.push_back(x.homogeneous());
      pixels.push_back((tracks.pixel[*k] - tracks.centre()) / unit);
    }
    ViewEstimator estimator(in_frame, pixels, frame.planar, options.max_error_px / unit);
    const RansacReport report = ransac(
        estimator,
        {.max_iterations = options.max_samples, .seed = options.seed, .stream = static_cast<uint64_t>(j)},
        &maps[j]);
    if (!report.found() || report.score.inliers < kMinKnownPoints) continue;
    start.image_posed[j] = 1;
    const double limit = std::pow(options.max_error_px / unit, 2);
    for (int i = 0; i < estimator.size(); ++i) {
      start.inlier[observations.begin(j)[i]] = estimator.error2(maps[j], i) < limit;
    }
  }
  const std::vector<double> focal =
      focal_lengths(maps, start.image_posed, frame.planar, options.equal_lenses);
  start.scene.points.assign(points.begin(), points.end());
  for (int j = 0; j < tracks.image_count; ++j) {
    start.scene.lenses.push_back(
        {unit * focal[j], unit * focal[j], tracks.centre().x(), tracks.centre().y(), 0});
    Rigid3 cam_from_frame = start.image_posed[j] ? pose_of_map(maps[j], focal[j], frame.planar) : Rigid3{};
    cam_from_frame.translation *= frame.scale;
    start.scene.cam_from_world.push_back(cam_from_frame * frame.frame_from_world);
  }
  return start;
}

}  // namespace raysfm
