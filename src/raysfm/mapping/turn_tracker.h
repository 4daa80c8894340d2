#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "raysfm/matching/pair_tracker.h"
#include "raysfm/scene/archive_fields.h"
#include "raysfm/scene/reconstruction.h"
#include "raysfm/views/tracking_rig.h"

namespace raysfm {

// Of a view that was not seen to move, only to turn.
struct TurnedPose {
  Rigid3 rig_from_world;
  Matrix6d covariance = Matrix6d::Zero();  // of the tangent of rig_from_world
};

template <typename A>
void archive_fields(A& a, TurnedPose& x) {
  archive(a, x.rig_from_world, x.covariance);
}

// What passes for a turn.
struct TurnRule {
  double explained = 0.85;  // part of what a view has in common with one before that a rotation must explain
  // Whether the view just before will do where one longer ago is not explained: parallax that comes slowly
  // passes.
  bool from_view_to_view = false;
};

template <typename A>
void archive_fields(A& a, TurnRule& x) {
  archive(a, x.explained, x.from_view_to_view);
}

// Poses of views that see nothing whose place is known, while the rig turns on the spot: the directions of
// corners that were seen a moment ago tell how it turned, and it is taken to stay where it was. A translation
// that is short beside the distance of all that is seen cannot be told from none; the covariance says how far
// that may be. Rays of different origins are taken for rays of one: what is seen is far.
class TurnTracker {
 public:
  explicit TurnTracker(const TrackingRig& rig) : rig_(rig) {}

  // Begins at a posed view that has its corners. `distance`: of what it sees, in units of the world.
  void begin(ViewPtr view, const TurnedPose& pose, double distance, const TurnRule& rule);
  void end();
  bool is_turning() const { return !trackers_.empty(); }

  // The next view, with its corners. None where a rotation does not explain what it sees; where that lasts,
  // the turn has ended.
  std::optional<TurnedPose> advance(const ViewPtr& view, uint64_t seed);

  template <typename A>
  void archive(A& a) {
    raysfm::archive(a, trackers_, base_, newest_, newest_view_, distance_, rule_, most_matches_, missed_);
  }

 private:
  void follow_from(ViewPtr view, const TurnedPose& pose);
  int match(const ViewPtr& view);
  bool gather(const View& view);
  std::optional<TurnedPose> turn(const View& view, uint64_t seed);
  Matrix6d covariance_after(const Eigen::Matrix3d& rotation) const;

  const TrackingRig& rig_;
  std::vector<PairTracker> trackers_;  // from the base, one for each camera; none: not turning
  TurnedPose base_, newest_;
  ViewPtr newest_view_;
  double distance_ = 0;
  TurnRule rule_;
  int most_matches_ = 0;                       // of a view with the base
  int missed_ = 0;                             // views in a row
  std::vector<Eigen::Vector3d> before_, now_;  // unit directions in the rig, of what the base and a view see
  double tolerance_ = 0;                       // of them, radians
};

}  // namespace raysfm
