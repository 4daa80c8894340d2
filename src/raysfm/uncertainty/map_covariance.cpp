#include "raysfm/uncertainty/map_covariance.h"

#include <algorithm>
#include <cstdlib>

#include "raysfm/uncertainty/window_covariance.h"

namespace raysfm {
namespace {

// Ten key frames before a frame, whose points it is posed by, and the ten after which it does not move any
// more.
constexpr int kWindow = 20, kEvery = 10;
// What is measured later is better from here on: nearer to the middle of the window.
constexpr int kMiddle = 5;
constexpr size_t kMostKnown = 64;
constexpr int kPoints = 20;  // of each key frame: more cost time and change little
constexpr RobustLoss kWindowLoss{RobustLoss::Kind::kHuber, 1.0};

}  // namespace

bool MapCovariance::is_due(const Map& map) const {
  const int count = static_cast<int>(map.keyframes.size());
  return count < measured_ || count >= measured_ + std::clamp(measured_, 1, kEvery);
}

void MapCovariance::measure(const TrackingRig& rig, std::span<const Rig> deviations, const Map& map,
                            int world) {
  const int end = static_cast<int>(map.keyframes.size()), first = std::max(0, end - kWindow);
  measured_ = end;
  if (end - first < 2) return;
  const auto window =
      window_covariance(rig, map, first, end, kWindowLoss, kPoints * (end - first), deviations);
  if (!window) return;
  factor_ = std::max(1.0, window->variance / window->independent_variance);
  for (int k = first; k < end; ++k) {
    const int frame = map.keyframes[k].frame;  // negative where it is one of an earlier run
    const bool is_better = first == 0 || k >= first + kMiddle;
    if (frame >= 0) keep({frame, world, window->poses[k - first]}, is_better);
  }
}

void MapCovariance::keep(const Known& found, bool is_better) {
  const auto at = std::ranges::lower_bound(known_, found.frame, {}, &Known::frame);
  if (at != known_.end() && at->frame == found.frame) {
    if (is_better || at->world != found.world) *at = found;
    return;
  }
  known_.insert(at, found);
  if (known_.size() > kMostKnown) known_.erase(known_.begin());
}

const MapCovariance::Known* MapCovariance::nearest(int world, int frame) const {
  const Known* best = nullptr;
  for (const Known& k : known_) {
    if (k.world == world && (!best || std::abs(k.frame - frame) < std::abs(best->frame - frame))) best = &k;
  }
  return best;
}

Matrix6d MapCovariance::of(int world, int keyframe_frame, const Rigid3& rig_from_keyframe,
                           const Matrix6d& points_fixed) const {
  Matrix6d sum = factor_ * points_fixed;
  const Known* known = nearest(world, keyframe_frame);
  if (!known) return sum;
  // The frame is about where the key frame is, and as far off: only its axes are others.
  const Eigen::Matrix3d turn = rig_from_keyframe.rotation.toRotationMatrix();
  Matrix6d turned = Matrix6d::Zero();
  turned.topLeftCorner<3, 3>() = turned.bottomRightCorner<3, 3>() = turn;
  sum += turned * known->covariance * turned.transpose();
  return 0.5 * (sum + sum.transpose());
}

void MapCovariance::rescale(int world, double factor) {
  const Eigen::Vector<double, 6> unit{factor, factor, factor, 1, 1, 1};
  for (Known& k : known_) {
    if (k.world == world) k.covariance = (unit.asDiagonal() * k.covariance * unit.asDiagonal()).eval();
  }
}

void MapCovariance::renumber(int world, int into) {
  for (Known& k : known_) {
    if (k.world == world) k.world = into;
  }
}

}  // namespace raysfm
