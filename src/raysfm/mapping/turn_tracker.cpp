#include "raysfm/mapping/turn_tracker.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

#include "raysfm/robust/rotation_ransac.h"

namespace raysfm {
namespace {

constexpr int kLeastMatches = 40;
constexpr double kTurnedError = 2;    // of an inlier, pixels of its octave
constexpr double kKeptMatches = 0.5;  // of those at best; with fewer, a later view becomes the base
constexpr int kMostMissed = 15;       // views in a row that are no turn

}  // namespace

void TurnTracker::begin(ViewPtr view, const TurnedPose& pose, double distance, const TurnRule& rule) {
  distance_ = distance;
  rule_ = rule;
  missed_ = 0;
  follow_from(std::move(view), pose);
}

void TurnTracker::end() {
  trackers_.clear();
  newest_view_.reset();
}

void TurnTracker::follow_from(ViewPtr view, const TurnedPose& pose) {
  trackers_ = trackers_from(view);
  base_ = newest_ = pose;
  newest_view_ = std::move(view);
  most_matches_ = 0;
}

int TurnTracker::match(const ViewPtr& view) {
  const int matches = raysfm::advance(trackers_, view);
  most_matches_ = std::max(most_matches_, matches);
  return matches;
}

std::optional<TurnedPose> TurnTracker::advance(const ViewPtr& view, uint64_t seed) {
  if (!is_turning()) return std::nullopt;
  const bool is_far = match(view) < kKeptMatches * most_matches_;
  const bool may_rebase = newest_view_->frame != trackers_[0].base_frame();
  const auto rebase = [&] {
    follow_from(newest_view_, newest_);
    match(view);
  };
  if (is_far && may_rebase) rebase();
  std::optional<TurnedPose> pose = turn(*view, seed);
  if (!pose && !is_far && may_rebase && rule_.from_view_to_view) {
    rebase();
    pose = turn(*view, seed);
  }
  if (pose) {
    missed_ = 0;
    newest_ = *pose;
    newest_view_ = view;
  } else if (++missed_ > kMostMissed) {
    end();
  }
  return pose;
}

// False where too little is matched.
bool TurnTracker::gather(const View& view) {
  before_.clear();
  now_.clear();
  double tolerance = 0;
  for (int c = 0; c < rig_.size(); ++c) {
    const Camera& camera = rig_.camera(c);
    const Features &seen = trackers_[c].base().features, &sees = view.cameras[c].features;
    const std::vector<int>& matches = trackers_[c].matches(trackers_[c].views() - 1);
    for (size_t f = 0; f < matches.size(); ++f) {
      Ray then, now;
      if (matches[f] < 0 || !camera.ray(seen.pixels[f].cast<double>(), &then) ||
          !camera.ray(sees.pixels[matches[f]].cast<double>(), &now)) {
        continue;
      }
      before_.push_back(camera.rig_from_cam.rotation * then.direction);
      now_.push_back(camera.rig_from_cam.rotation * now.direction);
      const uint8_t octave = std::max(seen.octaves[f], sees.octaves[matches[f]]);
      tolerance += kTurnedError * octave_side(octave) / rig_.pixels_per_radian(c);
    }
  }
  if (static_cast<int>(before_.size()) < kLeastMatches) return false;
  tolerance_ = tolerance / static_cast<double>(before_.size());
  return true;
}

std::optional<TurnedPose> TurnTracker::turn(const View& view, uint64_t seed) {
  if (!gather(view)) return std::nullopt;
  RotationRansac rotations(before_, now_, tolerance_);
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  const RansacReport found = ransac(rotations, {.seed = seed, .stream = view.random_stream()}, &rotation);
  if (found.score.inliers < rule_.explained * static_cast<double>(before_.size())) return std::nullopt;
  const Rigid3 rig_from_base{Eigen::Quaterniond(rotation), Eigen::Vector3d::Zero()};
  return TurnedPose{rig_from_base * base_.rig_from_world, covariance_after(rotation)};
}

// That of the base, that of the rotation, and a translation that the tolerance hides.
Matrix6d TurnTracker::covariance_after(const Eigen::Matrix3d& rotation) const {
  Matrix6d covariance = turned_covariance(rotation, base_.covariance);
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  double squares = 0;
  int inliers = 0;
  for (size_t i = 0; i < now_.size(); ++i) {
    const double square = (rotation * before_[i] - now_[i]).squaredNorm();
    if (square >= tolerance_ * tolerance_) continue;
    squares += square;
    ++inliers;
    information += Eigen::Matrix3d::Identity() - now_[i] * now_[i].transpose();
  }
  const double variance = squares / (2 * inliers - 3);
  covariance.bottomRightCorner<3, 3>() += variance * information.inverse();
  const double hidden = tolerance_ * distance_;
  covariance.topLeftCorner<3, 3>() += hidden * hidden * Eigen::Matrix3d::Identity();
  return covariance;
}

}  // namespace raysfm
