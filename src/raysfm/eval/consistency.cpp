#include "raysfm/eval/consistency.h"

#include <Eigen/Cholesky>
#include <Eigen/SVD>
#include <algorithm>
#include <string>

#include "raysfm/geometry/rotation.h"

namespace raysfm {
namespace {

constexpr double kEllipsoid90Of3 = 6.2514;  // chi-square of three degrees of freedom
constexpr int kShortestWindow = 4;

// Sums over frames.
struct Tally {
  int frames = 0, held = 0, judged = 0;
  double error2 = 0;

  void add(const Eigen::Vector3d& error, const Eigen::Matrix3d& covariance) {
    ++frames;
    const Eigen::LLT<Eigen::Matrix3d> factor(covariance);
    if (factor.info() != Eigen::Success) return;
    const double normalised2 = factor.matrixL().solve(error).squaredNorm();
    ++judged;
    error2 += normalised2;
    held += normalised2 <= kEllipsoid90Of3;
  }

  // `fitted` of the 3 * length numbers of each window are taken up by its alignment.
  Consistency result(int length, int fitted) const {
    Consistency c;
    if (frames > 0) c.held = static_cast<double>(held) / frames;
    if (judged > 0) c.normalised_error2 = error2 / ((3.0 - static_cast<double>(fitted) / length) * judged);
    return c;
  }
};

struct Window {
  std::vector<Rigid3> estimate, truth;
  std::vector<Matrix6d> covariances;

  int size() const { return static_cast<int>(estimate.size()); }

  // Errors in the axes and the unit of the estimate, where the covariances are.
  void judge_positions(Alignment alignment, Tally* tally) const {
    Eigen::Matrix3Xd from(3, size()), to(3, size());
    for (int i = 0; i < size(); ++i) from.col(i) = estimate[i].translation, to.col(i) = truth[i].translation;
    const Similarity3 truth_from_estimate = align_points(from, to, alignment);
    const Eigen::Quaterniond back = truth_from_estimate.rotation.conjugate();
    for (int i = 0; i < size(); ++i) {
      const Eigen::Vector3d off = truth[i].translation - truth_from_estimate * estimate[i].translation;
      tally->add(back * off / truth_from_estimate.scale, covariances[i].topLeftCorner<3, 3>());
    }
  }

  void judge_orientations(Alignment alignment, Tally* tally) const {
    Eigen::Quaterniond estimate_from_truth = Eigen::Quaterniond::Identity();
    if (alignment != Alignment::kNone) estimate_from_truth = mean_rotation();
    for (int i = 0; i < size(); ++i) {
      const Eigen::Vector3d off =
          log_so3(estimate_from_truth * truth[i].rotation * estimate[i].rotation.conjugate());
      tally->add(off, covariances[i].bottomRightCorner<3, 3>());
    }
  }

 private:
  // The rotation nearest to all that take a true orientation to the estimated one.
  Eigen::Quaterniond mean_rotation() const {
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    for (int i = 0; i < size(); ++i) {
      sum += (estimate[i].rotation * truth[i].rotation.conjugate()).toRotationMatrix();
    }
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(sum, Eigen::ComputeFullU | Eigen::ComputeFullV);
    Eigen::Vector3d signs(1, 1, 1);
    if ((svd.matrixU() * svd.matrixV().transpose()).determinant() < 0) signs.z() = -1;
    return Eigen::Quaterniond(
        Eigen::Matrix3d(svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose()));
  }
};

WindowConsistency consistency_of(std::span<const Match> matches, const Trajectory& estimate,
                                 std::span<const Matrix6d> covariances, const Trajectory& truth,
                                 Alignment alignment, int length) {
  WindowConsistency result;
  result.length = length;
  result.windows = static_cast<int>(matches.size()) / length;
  result.frames = length * result.windows;
  Tally positions, orientations;
  for (int w = 0; w < result.windows; ++w) {
    Window window;
    for (const Match& m : matches.subspan(static_cast<size_t>(w) * length, length)) {
      window.estimate.push_back(estimate.world_from_cam[m.estimate]);
      window.truth.push_back(truth.world_from_cam[m.truth]);
      window.covariances.push_back(covariances[m.estimate]);
    }
    window.judge_positions(alignment, &positions);
    window.judge_orientations(alignment, &orientations);
  }
  const bool aligned = alignment != Alignment::kNone;
  result.position = positions.result(length, alignment == Alignment::kSim3 ? 7 : aligned ? 6 : 0);
  result.orientation = orientations.result(length, aligned ? 3 : 0);
  return result;
}

}  // namespace

Result<std::vector<WindowConsistency>> window_consistency(const Trajectory& estimate,
                                                          std::span<const Matrix6d> covariances,
                                                          const Trajectory& truth,
                                                          const EvaluationOptions& options,
                                                          std::span<const int> lengths) {
  if (static_cast<int>(covariances.size()) != estimate.size()) {
    return bad_input(std::to_string(covariances.size()) + " covariances for " +
                     std::to_string(estimate.size()) + " poses of the estimate");
  }
  for (const int length : lengths) {
    if (length < kShortestWindow) {
      return bad_input("window: " + std::to_string(length) + " frames: at least " +
                       std::to_string(kShortestWindow) + " are needed");
    }
  }
  const std::vector<Match> matches = associate(estimate.timestamps, truth.timestamps, options.max_dt);
  std::vector<WindowConsistency> results;
  for (const int length : lengths) {
    results.push_back(consistency_of(matches, estimate, covariances, truth, options.alignment, length));
  }
  return results;
}

}  // namespace raysfm
