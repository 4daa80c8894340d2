// How Odometry comes by a better calibration.
#include <algorithm>
#include <cmath>

#include "raysfm/geometry/interpolation.h"
#include "raysfm/odometry/odometry.h"

namespace raysfm {
namespace {

constexpr int kMostRounds = 8;  // of one change, each from where the one before led
// Key frames that are adapted at once; those before them wait for the end.
constexpr int kAdapted = 40;
// Key frames of a world that is never adapted as a whole before the end. Up to so many, kitti07-mono, tsukuba
// and the kitchen are no better for what is done to larger ones.
constexpr int kLarge = 80;
// Effect of a change that a few steps do not adapt a map to: what is still off by more than an inlier may be
// is taken for an outlier. Of the maps of fr1-rpy, changed by 0.12 to 0.19, that left a twentieth.
constexpr double kConsiderable = 0.1;
// The same where a shutter rolls: what rows see moves each by another way.
constexpr double kBends = 0.01;
// Greatest effect of a change that bends what a large map has behind it. It stays bent, whatever is adjusted:
// its matches were chosen by the old calibration, and those that fit it hold the map about as well.
constexpr double kBendsPath = 0.015;
// Effect below which a further round is left to the next time, or the end.
constexpr double kMayWait = 0.01;

}  // namespace

// What the newest key frames of a world say of the calibration is measured; where that makes another one
// likely, all goes on with that.
void Odometry::refine_calibration(int number, bool last) {
  SegmentState& s = segments_[number];
  const int keyframes = static_cast<int>(s.map.keyframes.size());
  const bool asks_for_shutter =
      refiner_.is_shutter_due(keyframes, last) && std::ranges::find(s.is_known, 1) == s.is_known.end();
  const bool is_due = refiner_.is_due(number, s.map, last);
  if (!asks_for_shutter && !is_due) return;
  ScopedTimer timer(calibrate_timing_);
  refiner_.set_frame_interval(frame_interval());
  const auto motion_of = [&](int keyframe) { return keyframe_motion(s.map.keyframes[keyframe]); };
  const bool at_rest = last && is_bent_by_lens(number);
  using Measure = CalibrationRefiner::Measure;
  const auto measure_again = [&] {
    refiner_.measure_again(rig_, number, s.map, s.is_known, motion_of,
                           at_rest ? Measure::kAtRest : Measure::kEven);
  };
  std::optional<Rig> better;
  if (asks_for_shutter) better = refiner_.find_shutter(rig_, number, s.map, motion_of);
  if (!better && is_due) {
    // Much of what was measured is about key frames that were not adapted to the shutter yet.
    if (at_rest || (last && refiner_.has_found_shutter())) {
      measure_again();
    } else {
      refiner_.measure(rig_, number, s.map, s.is_known, motion_of);
    }
    if (rig_.scans()) refiner_.drop_turning_shutter(rig_, number, s.map, motion_of);
    better = refiner_.better(last);
  }
  if (!better) return;
  for (int round = 0; better && round < kMostRounds; ++round) {
    if (!take_calibration(number, *better, last)) break;
    measure_again();
    better = refiner_.better(last);
    const bool may_wait = !last && !asks_for_shutter && refiner_.has_found_shutter();
    if (may_wait && refiner_.effect() < kMayWait) break;
  }
  observer_->calibration_refined({frames() - 1, number, refiner_.numbers(), refiner_.contradicts()});
}

// Whether so much of a world came about with earlier lenses that its matches hold on to these. Of a guess
// what many key frames tell is taken as it comes; a shutter that rolls is no matter of the lens.
bool Odometry::is_bent_by_lens(int number) const {
  const auto keyframes = static_cast<int>(segments_[number].map.keyframes.size());
  return keyframes > kLarge && !options_.calibration_prior.is_guess && !rig_.scans();
}

// A world goes on with what was found of the calibration. True where that may lead on to another one.
bool Odometry::take_calibration(int number, const Rig& better, bool last) {
  const int keyframes = static_cast<int>(segments_[number].map.keyframes.size());
  ++calibration_;
  const bool scanned = rig_.scans();
  rig_ = TrackingRig(better, options_.error);
  if (rig_.scans() && !scanned) shutter_found_at_ = frames() - 1;
  if (is_bent_by_lens(number) && refiner_.greatest_effect() > kBendsPath) lens_found_at_ = frames() - 1;
  const bool is_far = refiner_.take_over();
  // A large map has its newest part adapted while it grows, and goes on with that.
  const bool all = last || keyframes <= kAdapted;
  // Motion tells the readout, and the readout and the lens the motion.
  const bool moves = all && refiner_.has_found_shutter();
  // Where rays have different origins, lens and scale tell each other: each moves with the other.
  const bool leads_on = is_far || moves || (all && !rig_.central());
  const Adaption how = adaption(number, last, leads_on);
  adapt(number, last ? 0 : std::max(0, keyframes - kAdapted), how);
  // Rounds that lead on to another one leave the weakest directions to finish_maps().
  if (last && how != Adaption::kTwoSeriesThinned) segments_[number].calibration = calibration_;
  if (all) find_scale(number);
  if (moves) pose_frames_again(number);
  return leads_on;
}

// How a world follows the change that was just taken over; `leads_on`: to another round.
Adaption Odometry::adaption(int number, bool last, bool leads_on) const {
  const bool is_long = static_cast<int>(segments_[number].map.keyframes.size()) > kAdapted;
  // What is weakest in a long world tells nothing of the calibration: it waits for the end of the rounds.
  if (last && is_long) return leads_on ? Adaption::kTwoSeriesThinned : whole_adaption(number);
  if (refiner_.effect() > kConsiderable) return Adaption::kToTheEnd;
  const bool bends = rig_.scans() && refiner_.effect() > kBends;
  return last || bends ? Adaption::kTwoSeries : Adaption::kThinned;
}

// What all of a world needs to follow a change along its weakest directions too.
Adaption Odometry::whole_adaption(int number) const {
  const SegmentState& s = segments_[number];
  if (static_cast<int>(s.map.keyframes.size()) <= kAdapted) return Adaption::kTwoSeries;
  return s.closed ? Adaption::kUntilSettled : Adaption::kToTheEnd;
}

// Of a world that is another calibration's now. `deviations`: how well that is known, where it counts.
void Odometry::find_scale(int number, std::span<const Rig> deviations) {
  if (rig_.central()) return;  // nothing tells it
  SegmentState& s = segments_[number];
  const double rescaled = s.map.rescaled;
  // Another scale may bend a map.
  adjust(number, [&](Map* map) {
    mapper_.measure_scale(s.closed ? ScaleEffort::kUntilSettled : ScaleEffort::kFull, map, deviations);
  });
  rescale_track(number, s.map.rescaled / rescaled);
}

std::optional<SeenZoom> Odometry::lens_change() {
  for (int s = 0; s < static_cast<int>(segments_.size()); ++s) {
    if (segments_[s].joined_into >= 0) continue;
    const Map& map = segments_[s].map;
    const auto motion_of = [&](int keyframe) { return keyframe_motion(map.keyframes[keyframe]); };
    if (const auto change = refiner_.focal_change(rig_, s, map, motion_of))
      return SeenZoom{map.keyframes[change->keyframe].frame, change->before, change->after};
  }
  return std::nullopt;
}

// Map, views and frames of a world as the present calibration has them, from a key frame on.
void Odometry::adapt(int number, int first_keyframe, Adaption how) {
  SegmentState& s = segments_[number];
  correct_scans(number, first_keyframe);
  adjust_from(number, first_keyframe, how);
  for (size_t k = 0; k < s.views.size(); ++k) renew_rays(rig_, s.map.keyframes[k], &s.views[k]);
}

// The key frames of a world from one on, and what hangs on them.
void Odometry::adjust_from(int number, int first_keyframe, Adaption how) {
  adjust(number, [&](Map* map) { mapper_.adapt_to_cameras(first_keyframe, how, map); });
}

// Moves key frames of a world, none of which come or go, and with them the frames that hang on them.
void Odometry::adjust(int number, const std::function<void(Map*)>& move_keyframes) {
  Map& map = segments_[number].map;
  std::vector<Rigid3> before;
  for (const MapKeyFrame& k : map.keyframes) before.push_back(k.rig_from_world);
  move_keyframes(&map);
  carry_frames(number, before);
}

// Between two key frames, frames follow the change of their relative pose by the part of the way that they
// have come.
void Odometry::carry_frames(int number, const std::vector<Rigid3>& before) {
  const std::vector<MapKeyFrame>& keyframes = segments_[number].map.keyframes;
  const int last = static_cast<int>(keyframes.size()) - 1;
  for (size_t f = 0; f < frames_.size(); ++f) {
    FrameRecord& frame = frames_[f];
    if (frame.segment != number || frame.keyframe > last) continue;
    const int a = std::min(frame.keyframe, last - 1), b = a + 1;
    Rigid3 then = before[b] * before[a].inverse();
    const Rigid3 now = keyframes[b].rig_from_world * keyframes[a].rig_from_world.inverse();
    const double scale = now.translation.norm() / then.translation.norm();
    if (!std::isfinite(scale)) continue;
    then.translation *= scale;
    scale_pose(scale, &frame);
    const int from = rank_of(keyframes[a].frame), to = rank_of(keyframes[b].frame);
    const double part = double(frame.rank - from) / double(to - from);
    if (frame.keyframe != a || !(part > 0) || part > 1) continue;
    frame.rig_from_keyframe = interpolate(Rigid3{}, now * then.inverse(), part) * frame.rig_from_keyframe;
  }
}

}  // namespace raysfm
