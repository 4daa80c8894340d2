#include "raysfm/uncertainty/window_covariance.h"

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>

#include "raysfm/features/octaves.h"
#include "raysfm/geometry/rotation.h"
#include "raysfm/uncertainty/calibration_changes.h"

namespace raysfm {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr int kColumns = 6, kRows = 4, kPoses = 5;  // of a neighbourhood
constexpr int kSampled = 8;         // one of so many tells what an adjustment hides of their errors
constexpr double kLeastLeft = 0.1;  // of these errors
// Standard deviations, beyond which an observation says nothing: the map may have moved since it fitted.
constexpr double kMostMisfit = 4;
constexpr double kLeastPivot = 1e-9;  // of equations whose diagonal is 1
// Of orientations in a fit by positions, for each radian the square of the extent of the path; of the
// logarithm of a scale, in residuals squared.
constexpr double kOrientationWeight = 1e-3, kLeastScaleWeight = 1e-2;

// The normal equations of one neighbourhood of points, which are eliminated: of the poses that see them.
struct Cluster {
  int first = 0, end = 0;  // poses that these are of
  MatrixXd information;
  VectorXd gradient;

  bool used() const { return end > first; }
  int begin_row() const { return 6 * first; }
  int rows() const { return 6 * (end - first); }
  int row_of(int pose) const { return 6 * (pose - first); }

  // Tracks are short beside a window: what is kept grows with the poses that they reach.
  void reach(int pose) {
    if (pose < end) return;
    end = pose + 1;
    information.conservativeResizeLike(MatrixXd::Zero(rows(), rows()));
    gradient.conservativeResizeLike(VectorXd::Zero(rows()));
  }
};

class Window {
 public:
  Window(const TrackingRig& rig, const Map& map, int first, int end, const RobustLoss& loss,
         std::span<const Rig> deviations)
      : rig_(rig),
        map_(map),
        first_(first),
        count_(end - first),
        loss_(loss),
        calibration_(rig, deviations),
        pull_(MatrixXd::Zero(6 * count_, calibration_.size())) {
    for (int k = first; k < end; ++k) {
      poses_.push_back(map.keyframes[k].rig_from_world);
      rotations_.push_back(poses_.back().rotation.toRotationMatrix());
    }
  }

  std::optional<WindowCovariance> run(int most_points) {
    choose_points();
    const int step = std::max(1, (static_cast<int>(points_.size()) + most_points - 1) / most_points);
    share_ = 1.0 / step;
    clusters_.resize(static_cast<size_t>(rig_.size()) * kColumns * kRows * (count_ / kPoses + 1));
    for (size_t i = 0; i < points_.size(); i += step) add_point(points_[i]);
    if (residuals_ <= 0) return std::nullopt;
    find_motions();
    if (!invert()) return std::nullopt;
    return result();
  }

 private:
  struct Term {
    int pose;
    Vector2d residual;
    double scale = 0;  // residual, in pixels or of an angle, to standard deviations and by its weight
    Eigen::Matrix<double, 2, 6> by_pose;
    Eigen::Matrix<double, 2, 3> by_point;
  };

  void choose_points() {
    constexpr uint8_t kSeen = 1, kSeenAgain = 2;
    std::vector<uint8_t> seen(map_.tracks.size(), 0);
    for (int k = 0; k < count_; ++k) {
      const MapKeyFrame& keyframe = map_.keyframes[first_ + k];
      for (int f = 0; f < keyframe.size(); ++f) {
        const int t = keyframe.tracks[f];
        if (t < 0 || !keyframe.inliers[f] || seen[t] == kSeenAgain) continue;
        if (seen[t]++ == kSeen && map_.tracks[t].triangulated) points_.push_back(t);
      }
    }
    std::sort(points_.begin(), points_.end());
  }

  bool differentiate(const TrackObservation& o, const Vector3d& point, Term* t) const {
    const MapKeyFrame& keyframe = map_.keyframes[o.keyframe];
    t->pose = o.keyframe - first_;
    const Vector3d x = rotations_[t->pose] * point + poses_[t->pose].translation;
    Eigen::Matrix<double, 2, 3> by_x;
    if (rig_.angular()) {
      if (!keyframe.rays[o.feature].residual(x, &t->residual, &by_x)) return false;
    } else {
      const int c = keyframe.cameras[o.feature];
      Vector2d pixel;
      Eigen::Matrix<double, 2, 3> by_x_in_cam;
      if (!rig_.camera(c).project(rig_.cam_from_rig(c) * x, &pixel, &by_x_in_cam)) return false;
      t->residual = pixel - keyframe.instant_pixel(o.feature).cast<double>();
      by_x = by_x_in_cam * rig_.cam_from_rig(c).rotation.toRotationMatrix();
    }
    const double scale = 1 / double(octave_side(keyframe.octaves[o.feature]));
    const double squares = scale * scale * t->residual.squaredNorm();
    if (!(squares < kMostMisfit * kMostMisfit)) return false;
    t->scale = scale * std::sqrt(loss_.weight(squares));
    t->residual *= t->scale;
    by_x *= t->scale;
    t->by_pose << by_x, -by_x * skew(x);
    t->by_point = by_x * rotations_[t->pose];
    return t->residual.allFinite();
  }

  void add_point(int track) {
    const Track& point = map_.tracks[track];
    terms_.clear();
    int cluster = -1, first = count_;
    for (const TrackObservation& o : point.observations) {
      if (o.keyframe < first_ || o.keyframe >= first_ + count_) continue;
      const MapKeyFrame& keyframe = map_.keyframes[o.keyframe];
      if (!keyframe.inliers[o.feature]) continue;
      Term t;
      if (!differentiate(o, point.position, &t) || !find_changes(o, point.position, t)) continue;
      if (t.pose < first) {  // tracks that were fused are in no order
        first = t.pose;
        cluster = cluster_of(keyframe.cameras[o.feature], keyframe.pixels[o.feature], first);
      }
      terms_.push_back(t);
    }
    if (terms_.size() < 2) return;
    Matrix3d v = Matrix3d::Zero();
    Vector3d gradient = Vector3d::Zero();
    for (const Term& t : terms_) {
      v.noalias() += t.by_point.transpose() * t.by_point;
      gradient.noalias() += t.by_point.transpose() * t.residual;
    }
    const Eigen::LDLT<Matrix3d> factor(v);
    if (!(factor.vectorD().minCoeff() > kLeastPivot * factor.vectorD().maxCoeff())) return;
    eliminate(factor, factor.solve(gradient), first, &clusters_[cluster]);
    pull_by_calibration(factor);
  }

  // What the next term does where the calibration is another.
  bool find_changes(const TrackObservation& o, const Vector3d& point, const Term& t) {
    if (calibration_.size() == 0) return true;
    const MapKeyFrame& keyframe = map_.keyframes[o.keyframe];
    const auto begin = static_cast<Eigen::Index>(terms_.size()) * calibration_.size();
    if (changes_.cols() < begin + calibration_.size())
      changes_.conservativeResize(2, 2 * (begin + calibration_.size()));
    auto changes = changes_.middleCols(begin, calibration_.size());
    const Vector3d x = rotations_[t.pose] * point + poses_[t.pose].translation;
    if (!calibration_.at(keyframe.cameras[o.feature], keyframe.instant_pixel(o.feature).cast<double>(),
                         rig_.angular() ? &keyframe.rays[o.feature] : nullptr, x, changes)) {
      return false;
    }
    changes *= t.scale;
    return true;
  }

  // Adds how the terms of a point pull at the poses where the calibration is another and the point moves with
  // it.
  void pull_by_calibration(const Eigen::LDLT<Matrix3d>& factor) {
    const int size = calibration_.size();
    if (size == 0) return;
    by_point_.setZero(3, size);
    for (size_t i = 0; i < terms_.size(); ++i)
      by_point_.noalias() += terms_[i].by_point.transpose() * changes_.middleCols(i * size, size);
    by_point_ = factor.solve(by_point_).eval();
    for (size_t i = 0; i < terms_.size(); ++i) {
      const Term& t = terms_[i];
      pull_.middleRows<6>(6 * t.pose).noalias() +=
          t.by_pose.transpose() * (changes_.middleCols(i * size, size) - t.by_point * by_point_);
    }
  }

  // Adds what the terms of a point, which moves by `step`, say of the poses, of which `first` is the first.
  void eliminate(const Eigen::LDLT<Matrix3d>& factor, const Vector3d& step, int first, Cluster* cluster) {
    Cluster& c = *cluster;
    if (!c.used()) c.first = c.end = first / kPoses * kPoses;
    int last = first;
    for (const Term& t : terms_) last = std::max(last, t.pose);
    c.reach(last);
    for (const Term& t : terms_) {
      const int row = c.row_of(t.pose);
      const Vector2d left = t.residual - t.by_point * step;
      squares_ += left.squaredNorm();
      c.gradient.segment<6>(row).noalias() += t.by_pose.transpose() * left;
      c.information.block<6, 6>(row, row).noalias() += t.by_pose.transpose() * t.by_pose;
    }
    residuals_ += 2 * static_cast<int>(terms_.size()) - 3;
    const Matrix3d point_covariance = factor.solve(Matrix3d::Identity());
    for (size_t i = 0; i < terms_.size(); ++i) {
      const Term& s = terms_[i];
      const Eigen::Matrix<double, 6, 3> w = s.by_pose.transpose() * (s.by_point * point_covariance);
      for (size_t j = i; j < terms_.size(); ++j) {
        const Term& t = terms_[j];
        const Eigen::Matrix<double, 6, 2> left = w * t.by_point.transpose();
        const Matrix6d product = left * t.by_pose;
        c.information.block<6, 6>(c.row_of(s.pose), c.row_of(t.pose)) -= product;
        if (j > i) c.information.block<6, 6>(c.row_of(t.pose), c.row_of(s.pose)) -= product.transpose();
      }
    }
  }

  int cluster_of(int camera, const Eigen::Vector2f& pixel, int pose) const {
    const auto cell = [](float x, int size, int cells) {
      return std::clamp(static_cast<int>(x / static_cast<float>(size) * static_cast<float>(cells)), 0,
                        cells - 1);
    };
    const int row = cell(pixel.y(), rig_.camera(camera).height, kRows);
    const int column = cell(pixel.x(), rig_.camera(camera).width, kColumns);
    return (((pose / kPoses) * rig_.size() + camera) * kRows + row) * kColumns + column;
  }

  // How the poses move with the world: shifted, turned about its origin, scaled about the middle of the path;
  // and which of these motions fits a change of the poses best, by their positions or their orientations.
  void find_motions() {
    motions_ = MatrixXd::Zero(6 * count_, 7);
    std::vector<Vector3d> centres;
    Vector3d middle = Vector3d::Zero();
    for (const Rigid3& p : poses_) {
      centres.push_back(p.inverse().translation);
      middle += centres.back() / count_;
    }
    double spread = 0;
    for (int k = 0; k < count_; ++k) {
      motions_.block<3, 3>(6 * k, 0) = rotations_[k];
      motions_.block<3, 3>(6 * k, 3) = skew(poses_[k].translation) * rotations_[k];
      motions_.block<3, 3>(6 * k + 3, 3) = rotations_[k];
      motions_.block<3, 1>(6 * k, 6) = rotations_[k] * (middle - centres[k]);
      spread += (centres[k] - middle).squaredNorm() / count_;
    }
    // Positions on a line say nothing of the turn about it: orientations do.
    fit_positions_ = fit(1, kOrientationWeight * spread);
    fit_orientations_ = fit(0, 1).middleRows<3>(3);
  }

  MatrixXd fit(double position_weight, double orientation_weight) const {
    MatrixXd weighted = motions_;
    for (int k = 0; k < count_; ++k) {
      weighted.middleRows<3>(6 * k) *= position_weight;
      weighted.middleRows<3>(6 * k + 3) *= orientation_weight;
    }
    if (position_weight > 0) return (motions_.transpose() * weighted).ldlt().solve(weighted.transpose());
    MatrixXd turns = MatrixXd::Zero(7, 6 * count_);
    turns.middleRows<3>(3) = (motions_.middleCols<3>(3).transpose() * weighted.middleCols<3>(3))
                                 .ldlt()
                                 .solve(weighted.middleCols<3>(3).transpose());
    return turns;
  }

  // The inverse of the normal equations, with some value for the motions of the world that they leave free.
  bool invert() {
    MatrixXd information = MatrixXd::Zero(6 * count_, 6 * count_);
    for (const Cluster& c : clusters_) {
      if (c.used()) information.block(c.begin_row(), c.begin_row(), c.rows(), c.rows()) += c.information;
    }
    // What little rays of different origins may say of the scale is no reason to give up.
    if (!rig_.central()) {
      information += kLeastScaleWeight * fit_positions_.row(6).transpose() * fit_positions_.row(6);
    }
    if (!(information.diagonal().minCoeff() > 0)) return false;
    const VectorXd scale = information.diagonal().cwiseSqrt().cwiseInverse();
    const MatrixXd free = scale.cwiseInverse().asDiagonal() * motions_.leftCols(rig_.central() ? 7 : 6);
    const MatrixXd basis =
        Eigen::HouseholderQR<MatrixXd>(free).householderQ() * MatrixXd::Identity(free.rows(), free.cols());
    const MatrixXd scaled = scale.asDiagonal() * information * scale.asDiagonal() + basis * basis.transpose();
    const Eigen::LLT<MatrixXd> factor(scaled);
    if (factor.info() != Eigen::Success) return false;
    if (!(factor.matrixLLT().diagonal().cwiseAbs2().minCoeff() > kLeastPivot)) return false;
    inverse_ = factor.solve(MatrixXd::Identity(6 * count_, 6 * count_));
    inverse_ = (scale.asDiagonal() * inverse_ * scale.asDiagonal()).eval();
    return true;
  }

  // The covariance after the motion of the world that fits positions, or orientations, best was taken off;
  // `freedoms` of the numbers of the former. What scales the path about its middle neither shifts nor turns
  // it, so that the first six numbers of the fit are those of a rigid one.
  MatrixXd aligned(const MatrixXd& covariance, int freedoms) const {
    MatrixXd motions = MatrixXd::Zero(6 * count_, freedoms + 3), fits(freedoms + 3, 6 * count_);
    for (int k = 0; k < count_; ++k) {
      motions.block(6 * k, 0, 3, freedoms) = motions_.block(6 * k, 0, 3, freedoms);
      motions.block<3, 3>(6 * k + 3, freedoms) = motions_.block<3, 3>(6 * k + 3, 3);
    }
    fits << fit_positions_.topRows(freedoms), fit_orientations_;
    const MatrixXd fitted = fits * covariance;
    const MatrixXd taken = motions * (fitted - 0.5 * (fitted * fits.transpose()) * motions.transpose());
    return covariance - taken - taken.transpose();
  }

  // Each neighbourhood pulls at the poses; how hard, beside what independent errors of the same poses and
  // points would do, which those that are left after the adjustment fall short of.
  double variance() const {
    VectorXd gradient = VectorXd::Zero(6 * count_);
    for (const Cluster& c : clusters_) {
      if (c.used()) gradient.segment(c.begin_row(), c.rows()) += c.gradient;
    }
    const VectorXd step = inverse_ * gradient;
    double scatter = 0, expected = 0, sampled = 0, lost = 0;
    int number = 0;
    for (const Cluster& c : clusters_) {
      if (!c.used()) continue;
      const int row = c.begin_row(), rows = c.rows();
      const MatrixXd& information = c.information;
      const auto inverse = inverse_.block(row, row, rows, rows);
      const VectorXd left = c.gradient - information * step.segment(row, rows);
      const double weight = inverse.cwiseProduct(information).sum();
      scatter += left.dot(inverse * left);
      expected += weight;
      if (number++ % kSampled != 0) continue;
      const MatrixXd part = inverse * information;
      sampled += weight;
      lost += part.cwiseProduct(part.transpose()).sum();
    }
    return scatter / (expected * std::max(kLeastLeft, 1 - lost / sampled));
  }

  // Rays of different origins tell a scale: how well, is known of the whole map with what goes together in
  // their errors, and what is held at a wrong scale is bent. Where the scale is metric a window may know it
  // better by itself, and where it hardly does the scale of the map may have drifted as much again.
  void replace_scale(MatrixXd* covariance) const {
    if (rig_.central() || !std::isfinite(map_.scale_sigma)) return;
    const VectorXd with_scale = *covariance * fit_positions_.row(6).transpose();
    const double told = fit_positions_.row(6).dot(with_scale), known = map_.scale_sigma * map_.scale_sigma;
    if (!(told > 0)) return;
    const VectorXd by_scale = with_scale / told;
    *covariance += ((metric() ? std::min(2 * known, told) : known) - told) * by_scale * by_scale.transpose();
  }

  bool metric() const { return map_.scale_sigma < kMetricSigma; }

  std::optional<WindowCovariance> result() const {
    WindowCovariance w;
    w.independent_variance = squares_ / residuals_;
    w.variance = variance();
    MatrixXd covariance = std::max(w.variance, w.independent_variance) * share_ * inverse_;
    covariance = aligned(covariance, 6);
    replace_scale(&covariance);
    if (!metric()) covariance = aligned(covariance, 7);
    const MatrixXd moved = inverse_ * pull_;
    const MatrixXd by_calibration = aligned(moved * moved.transpose(), metric() ? 6 : 7);
    if (!covariance.allFinite() || !by_calibration.allFinite()) return std::nullopt;
    for (int k = 0; k < count_; ++k) {
      w.poses.push_back(covariance.block<6, 6>(6 * k, 6 * k));
      w.by_calibration.push_back(by_calibration.block<6, 6>(6 * k, 6 * k));
    }
    return w;
  }

  const TrackingRig& rig_;
  const Map& map_;
  const int first_, count_;
  const RobustLoss& loss_;
  CalibrationChanges calibration_;
  MatrixXd pull_;  // of each other calibration, the gradient of all poses
  std::vector<Rigid3> poses_;
  std::vector<Matrix3d> rotations_;
  std::vector<int> points_;
  std::vector<Term> terms_;
  Eigen::Matrix2Xd changes_;  // of the terms, by calibrations
  Eigen::Matrix3Xd by_point_;
  std::vector<Cluster> clusters_;
  MatrixXd motions_, fit_positions_, fit_orientations_, inverse_;
  double squares_ = 0, share_ = 1;
  int residuals_ = 0;
};

}  // namespace

std::optional<WindowCovariance> window_covariance(const TrackingRig& rig, const Map& map, int first, int end,
                                                  const RobustLoss& loss, int most_points,
                                                  std::span<const Rig> deviations) {
  return Window(rig, map, first, end, loss, deviations).run(most_points);
}

}  // namespace raysfm
