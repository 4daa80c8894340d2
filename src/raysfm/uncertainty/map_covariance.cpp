#include "raysfm/uncertainty/map_covariance.h"

#include <algorithm>
#include <iterator>

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
  measured_ = static_cast<int>(map.keyframes.size());
  measure_window(rig, deviations, map, world, measured_);
  if (known_.size() > kMostKnown) known_.erase(known_.begin(), known_.end() - kMostKnown);
}

void MapCovariance::measure_all(const TrackingRig& rig, std::span<const Rig> deviations, const Map& map,
                                int world) {
  const int count = static_cast<int>(map.keyframes.size());
  for (int end = std::min(count, kWindow); end < count; end += kEvery)
    measure_window(rig, deviations, map, world, end);
  measure_window(rig, deviations, map, world, count);
}

// The last key frames before `end`.
void MapCovariance::measure_window(const TrackingRig& rig, std::span<const Rig> deviations, const Map& map,
                                   int world, int end) {
  const int first = std::max(0, end - kWindow);
  if (end - first < 2) return;
  const auto window =
      window_covariance(rig, map, first, end, kWindowLoss, kPoints * (end - first), deviations);
  if (!window) return;
  factor_ = std::max(1.0, window->variance / window->independent_variance);
  for (int k = first; k < end; ++k) {
    const int frame = map.keyframes[k].frame;  // negative where it is one of an earlier run
    const bool is_better = first == 0 || k >= first + kMiddle;
    if (frame >= 0)
      keep({frame, world, window->poses[k - first], window->by_calibration[k - first]}, is_better);
  }
}

void MapCovariance::keep(const Known& found, bool is_better) {
  const auto at = std::ranges::lower_bound(known_, found.frame, {}, &Known::frame);
  if (at != known_.end() && at->frame == found.frame) {
    if (is_better || at->world != found.world) *at = found;
    return;
  }
  known_.insert(at, found);
}

const MapCovariance::Known* MapCovariance::nearest(int world, int frame) const {
  const auto is_of_world = [&](const Known& k) { return k.world == world; };
  const auto middle = std::ranges::lower_bound(known_, frame, {}, &Known::frame);
  const auto after = std::find_if(middle, known_.end(), is_of_world);
  const auto before = std::find_if(std::make_reverse_iterator(middle), known_.rend(), is_of_world);
  if (before == known_.rend()) return after == known_.end() ? nullptr : &*after;
  return after == known_.end() || frame - before->frame <= after->frame - frame ? &*before : &*after;
}

Matrix6d MapCovariance::of(int world, int keyframe_frame, const Rigid3& rig_from_keyframe,
                           const Matrix6d& points_fixed) const {
  Matrix6d sum = factor_ * points_fixed;
  const Known* known = nearest(world, keyframe_frame);
  if (!known) return sum;
  // A frame is about where its key frame is, and as far off: only its axes are others.
  sum += turned_covariance(rig_from_keyframe.rotation.toRotationMatrix(), known->covariance);
  return 0.5 * (sum + sum.transpose());
}

Matrix6d MapCovariance::by_calibration(int world, int keyframe_frame, const Rigid3& rig_from_keyframe) const {
  const Known* known = nearest(world, keyframe_frame);
  if (!known) return Matrix6d::Zero();
  const Matrix6d turned =
      turned_covariance(rig_from_keyframe.rotation.toRotationMatrix(), known->by_calibration);
  return 0.5 * (turned + turned.transpose());
}

void MapCovariance::rescale(int world, double factor) {
  const Eigen::Vector<double, 6> unit{factor, factor, factor, 1, 1, 1};
  for (Known& k : known_) {
    if (k.world != world) continue;
    for (Matrix6d* m : {&k.covariance, &k.by_calibration})
      *m = (unit.asDiagonal() * *m * unit.asDiagonal()).eval();
  }
}

void MapCovariance::renumber(int world, int into) {
  for (Known& k : known_) {
    if (k.world == world) k.world = into;
  }
}

}  // namespace raysfm
