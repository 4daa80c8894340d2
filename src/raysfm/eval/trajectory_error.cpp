#include "raysfm/eval/trajectory_error.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

namespace raysfm {
namespace {

// Length of the path up to each pose.
std::vector<double> path_lengths(std::span<const Rigid3> poses) {
  std::vector<double> path(poses.size(), 0.0);
  for (size_t i = 1; i < poses.size(); ++i) {
    path[i] = path[i - 1] + (poses[i].translation - poses[i - 1].translation).norm();
  }
  return path;
}

Eigen::Matrix3Xd positions(std::span<const Rigid3> poses) {
  Eigen::Matrix3Xd points(3, poses.size());
  for (size_t i = 0; i < poses.size(); ++i) points.col(i) = poses[i].translation;
  return points;
}

// Axes of the plane of the two largest principal components of the positions, as Evaluation has them.
Eigen::Matrix<double, 2, 3> plane_of_motion(std::span<const Rigid3> poses) {
  const Eigen::Matrix3Xd points = positions(poses);
  const Eigen::Matrix3Xd centred = points.colwise() - points.rowwise().mean();
  const Eigen::Matrix3d covariance = centred * centred.transpose();
  const Eigen::Matrix3d axes = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(covariance).eigenvectors();
  Eigen::Vector3d right = axes.col(2);
  if (right.dot(points.rightCols<1>() - points.leftCols<1>()) < 0) right = -right;
  Eigen::Vector3d down = Eigen::Vector3d::Zero();
  for (const Rigid3& pose : poses) down += pose.rotation * Eigen::Vector3d::UnitY();
  Eigen::Vector3d ahead = axes.col(1);
  if (right.cross(ahead).dot(down) > 0) ahead = -ahead;
  Eigen::Matrix<double, 2, 3> plane_from_world;
  plane_from_world << right.transpose(), ahead.transpose();
  return plane_from_world;
}

std::vector<PosePair> consecutive_pairs(int count) {
  std::vector<PosePair> pairs;
  for (int i = 1; i < count; ++i) pairs.push_back({i - 1, i});
  return pairs;
}

std::vector<double> column_norms(const Eigen::MatrixXd& columns) {
  std::vector<double> norms(columns.cols());
  for (Eigen::Index i = 0; i < columns.cols(); ++i) norms[i] = columns.col(i).norm();
  return norms;
}

std::string too_few_matches(const Trajectory& estimate, const Trajectory& truth, size_t matched,
                            size_t needed, double max_dt) {
  std::string message = std::to_string(matched) + " poses of the estimate match the truth within " +
                        std::to_string(max_dt) + " s, at least " + std::to_string(needed) + " are needed";
  for (const auto& [name, trajectory] : {std::pair{"estimate", &estimate}, std::pair{"truth", &truth}}) {
    message += std::string("; ") + name + ": " + std::to_string(trajectory->size()) + " poses";
    if (trajectory->size() == 0) continue;
    message += " from " + std::to_string(trajectory->timestamps.front()) + " to " +
               std::to_string(trajectory->timestamps.back()) + " s";
  }
  return message;
}

}  // namespace

ErrorStatistics error_statistics(std::vector<double> errors) {
  std::sort(errors.begin(), errors.end());
  const size_t count = errors.size();
  ErrorStatistics statistics;
  for (const double e : errors) {
    statistics.mean += e / static_cast<double>(count);
    statistics.rmse += e * e / static_cast<double>(count);
  }
  statistics.rmse = std::sqrt(statistics.rmse);
  statistics.median = 0.5 * (errors[(count - 1) / 2] + errors[count / 2]);
  statistics.max = errors.back();
  return statistics;
}

RelativeError relative_error(std::span<const Rigid3> estimate, std::span<const Rigid3> truth,
                             std::span<const PosePair> pairs) {
  double translation2 = 0;
  double angle2 = 0;
  for (const auto& [i, j] : pairs) {
    const Rigid3 true_motion = truth[i].inverse() * truth[j];
    const Rigid3 motion = estimate[i].inverse() * estimate[j];
    const Rigid3 error = true_motion.inverse() * motion;
    const double angle = rotation_angle(error.rotation);
    translation2 += error.translation.squaredNorm();
    angle2 += angle * angle;
  }
  const double count = static_cast<double>(pairs.size());
  return {std::sqrt(translation2 / count), std::sqrt(angle2 / count) * 180.0 / std::numbers::pi};
}

Result<Evaluation> evaluate(const Trajectory& estimate, const Trajectory& truth,
                            const EvaluationOptions& options) {
  Evaluation result;
  result.matches = associate(estimate.timestamps, truth.timestamps, options.max_dt);
  const size_t needed = options.alignment == Alignment::kNone ? 2 : 3;
  if (result.matches.size() < needed) {
    return bad_input(too_few_matches(estimate, truth, result.matches.size(), needed, options.max_dt));
  }

  const std::vector<double> full_path = path_lengths(truth.world_from_cam);
  std::vector<Rigid3> estimated_poses, true_poses;
  std::vector<double> path;
  for (const auto& [i, j] : result.matches) {
    estimated_poses.push_back(estimate.world_from_cam[i]);
    true_poses.push_back(truth.world_from_cam[j]);
    path.push_back(full_path[j]);
  }

  const Eigen::Matrix3Xd true_positions = positions(true_poses);
  result.truth_from_estimate = align_points(positions(estimated_poses), true_positions, options.alignment);
  for (Rigid3& pose : estimated_poses) pose = transform_pose(result.truth_from_estimate, pose);

  const Eigen::Matrix3Xd difference = positions(estimated_poses) - true_positions;
  result.plane_from_world = plane_of_motion(true_poses);
  result.position_errors = column_norms(difference);
  result.ate = error_statistics(result.position_errors);
  result.ate_horizontal = error_statistics(column_norms(result.plane_from_world * difference));

  result.coverage = static_cast<double>(result.matches.size()) / truth.size();
  result.length = path.back() - path.front();
  result.rpe = relative_error(estimated_poses, true_poses, consecutive_pairs(result.matches.size()));
  result.kitti = kitti_drift(estimated_poses, true_poses, path);
  return result;
}

}  // namespace raysfm
