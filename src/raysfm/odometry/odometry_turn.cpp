// What Odometry does with a rig that only turns, before any world has started and where none ever does.
#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "raysfm/core/median.h"
#include "raysfm/odometry/odometry.h"

namespace raysfm {
namespace {

// Starts that were refused after which turns are followed: most footage starts with fewer.
constexpr int kRefusedStarts = 3;
// Of worlds that only turn: part of the frames, and of a world radians from its first frame to the one that
// is farthest from it.
constexpr double kLeastPart = 0.5, kLeastTurn = 0.1;
constexpr int kLeastFrames = 6;
constexpr double kKeyFrameTurn = 0.15;  // radians from one key frame to the next
// Such a world's unit of length is the distance of what is seen.
constexpr double kDistance = 1;
constexpr double kOriginVariance = 1e-10;  // of where such a world begins, for all covariances to be definite
// As long as nothing starts, the rest is blur, a rolling shutter and a little parallax.
constexpr TurnRule kRule{.explained = 0.6, .from_view_to_view = true};

// Radians from the first frame of a turn to the one that is farthest from it.
template <typename TurnedFrame>
double widest_angle(const std::vector<TurnedFrame>& turn) {
  double widest = 0;
  for (const TurnedFrame& t : turn)
    widest = std::max(widest,
                      turn[0].pose.rig_from_world.rotation.angularDistance(t.pose.rig_from_world.rotation));
  return widest;
}

// Of what a map sees from a pose.
double median_distance(const Map& map, const Rigid3& rig_from_world) {
  std::vector<double> distances;
  for (const Track& t : map.tracks) {
    if (t.triangulated) distances.push_back((rig_from_world * t.position).norm());
  }
  return median_of(&distances);
}

// Of a turned pose where what is seen is so far.
Matrix6d scaled_covariance(const TurnedPose& pose, double distance) {
  Matrix6d scaled = pose.covariance;
  scaled.topRows<3>() *= distance / kDistance;
  scaled.leftCols<3>() *= distance / kDistance;
  return scaled;
}

}  // namespace

// The views that the starter has, the newest one among them, where it begins; then each that comes.
void Odometry::follow_early_turn(const ViewPtr& view) {
  if (!options_.departures.turning || !segments_.empty() || starter_->attempts() < kRefusedStarts) return;
  if (early_turn_.begun) return add_to_early_turn(view);
  begin_early_turn();
}

void Odometry::begin_early_turn() {
  early_turn_.begun = true;
  for (const WaitingView& waiting : starter_->views()) {
    if (waiting.view) add_to_early_turn(waiting.view);
  }
}

void Odometry::add_to_early_turn(const ViewPtr& view) {
  std::vector<std::vector<TurnedFrame>>& turns = early_turn_.turns;
  if (!turner_.is_turning()) {
    const TurnedPose origin{{}, kOriginVariance * Matrix6d::Identity()};
    turner_.begin(view, origin, kDistance, kRule);
    turns.push_back({{view->frame, origin}});
  } else if (const auto turned = turner_.advance(view, options_.seed)) {
    turns.back().push_back({view->frame, *turned});
  }
}

// Frames that a world does not pose, but that were seen to turn until one that it does: those before its map,
// and those whose images were released while they waited.
void Odometry::take_early_turn() {
  const EarlyTurn early = std::exchange(early_turn_, {});
  if (early.turns.empty()) return;
  const std::vector<TurnedFrame>& turn = early.turns.back();
  const Map& map = segment().map;
  const TurnedFrame* known = nullptr;
  double distance = 0;  // of what the map sees from it
  for (auto t = turn.rbegin(); t != turn.rend(); ++t) {
    const FrameRecord& frame = frames_[t->frame];
    if (frame.segment < 0) {
      if (known) turn_from(*known, *t, distance);
      continue;
    }
    known = &*t;
    const bool is_next = std::next(t) != turn.rend() && frames_[std::next(t)->frame].segment < 0;
    if (is_next) distance = median_distance(map, present_pose(frame, map));
  }
}

void Odometry::turn_from(const TurnedFrame& known, const TurnedFrame& turned, double distance) {
  const FrameRecord& frame = frames_[known.frame];
  const Rigid3 from_known = turned.pose.rig_from_world * known.pose.rig_from_world.inverse();
  const Matrix6d covariance = frame.covariance + scaled_covariance(known.pose, distance);
  record_turned(turned.frame,
                {from_known * present_pose(frame, segment().map),
                 turned_covariance(from_known.rotation.toRotationMatrix(), covariance)},
                frame.keyframe);
}

// Of a frame that was only seen to turn, in the active world.
void Odometry::record_turned(int number, const TurnedPose& pose, int keyframe) {
  Localisation turned;
  turned.rig_from_world = pose.rig_from_world;
  record(number, turned, keyframe, pose.covariance);
  frames_[number].place_held = true;
}

// Worlds of orientations, where no other has started: key frames without points. None of turns that are
// short, and none at all where these are not most of what there is.
void Odometry::begin_turned_worlds() {
  if (!segments_.empty() || !options_.departures.turning) return;
  if (!early_turn_.begun) begin_early_turn();
  std::vector<std::vector<TurnedFrame>> turns = std::exchange(early_turn_, {}).turns;
  turner_.end();
  std::erase_if(turns, [](const auto& turn) {
    return std::ssize(turn) < kLeastFrames || widest_angle(turn) < kLeastTurn;
  });
  std::ptrdiff_t turned = 0;
  for (const auto& turn : turns) turned += std::ssize(turn);
  if (turned < kLeastPart * rank_of(frames() - 1)) return;
  for (const auto& turn : turns) begin_turned_world(turn);
}

void Odometry::begin_turned_world(const std::vector<TurnedFrame>& turn) {
  SegmentState& s = segments_.emplace_back();
  active_ = static_cast<int>(segments_.size()) - 1;
  s.calibration = calibration_;
  s.start = {"turn", {turn.front().frame, turn[turn.size() / 2].frame, turn.back().frame}, 0};
  observer_->world_started({world(), s.start});
  for (const TurnedFrame& t : turn) {
    const Rigid3& pose = t.pose.rig_from_world;
    const bool is_far =
        s.map.keyframes.empty() ||
        s.map.keyframes.back().rig_from_world.rotation.angularDistance(pose.rotation) > kKeyFrameTurn;
    if (is_far) {
      MapKeyFrame& keyframe = s.map.keyframes.emplace_back();
      keyframe.frame = t.frame;
      keyframe.rig_from_world = pose;
      s.views.emplace_back();
    }
    record_turned(t.frame, t.pose, static_cast<int>(s.map.keyframes.size()) - 1);
  }
}

}  // namespace raysfm
