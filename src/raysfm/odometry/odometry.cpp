#include "raysfm/odometry/odometry.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cassert>
#include <cstdlib>
#include <utility>

#include "raysfm/core/heap.h"
#include "raysfm/core/median.h"
#include "raysfm/views/blindness.h"
#include "raysfm/views/dead_features.h"

namespace raysfm {
namespace {

// Key frames after which a place is remembered: its points have positions then.
constexpr int kPlaceAge = 5;
// Times the interval between two views before, for which nothing else may be seen while the rig moves.
constexpr double kStandsAfter = 2.5;
// Beside the rules of 2.4, a key frame is due once the camera has moved by this part of the distance to the
// points: new points are then worth having, and patches have not changed much yet.
constexpr double kKeyFrameBaseline = 0.055;
// Part of the points of the anchor: as long as it is in sight, no blurred view becomes a key frame.
constexpr double kMostlyInSight = 0.75;
// How far a blurred view may be from where the motion before leads: parts of the step that leads there, and
// of the distance to the points.
constexpr double kMostSwerve = 1.5, kMostTremble = 0.01;
constexpr int kMinKeyFrameGap = 2;  // frames without one, unless too little is matched
// Where much of what a key frame shows was not found again (MotionWatch), the next ones are nearer to each
// other: what passes close by, of a car that drives backwards above all, is not the same for long.
constexpr double kNearerBaseline = kKeyFrameBaseline / 3;
constexpr double kKeyFrameShare = 0.6;  // rule 1 of 2.4 where the key frame has few points

// A motion continued, or cut short: its rotation and translation by the same part, which may exceed 1.
Rigid3 part_of(const Rigid3& motion, double part) {
  const Eigen::AngleAxisd turn(motion.rotation);
  return {Eigen::Quaterniond(Eigen::AngleAxisd(part * turn.angle(), turn.axis())), part * motion.translation};
}

// Angles as they are shrink as the focal length grows, so that they tell none: it would only get longer.
LensRefinement refinement_of(const OdometryOptions& options) {
  return options.error == ErrorMeasure::kAngularPlain ? LensRefinement::kOff : options.refine_lens;
}

// Where nobody listens.
TrackerObserver& nobody() {
  static TrackerObserver observer;
  return observer;
}

}  // namespace

Odometry::Odometry(Rig rig, const OdometryOptions& options, TrackerObserver* observer, const ViewMaker* maker)
    : options_(options),
      rig_(std::move(rig), options.error),
      observer_(observer != nullptr ? observer : &nobody()),
      maker_(maker),
      localiser_(rig_, options_),
      mapper_(rig_, options_),
      places_(rig_, options_.seed),
      refiner_(rig_.rig(), refinement_of(options_), options_.calibration_prior),
      turner_(rig_) {
  starter_.emplace(rig_, options_);
}

FrameResult Odometry::process(ViewPtr view) {
  const Clock::time_point begin = Clock::now();
  const int frame = view->frame;
  assert(frame == frames());
  frames_.emplace_back();
  frames_.back().timestamp = view->timestamp;
  frames_.back().name = view->name;
  frames_.back().reason = view->defect;
  frames_.back().same_as = view->same_as;
  frames_.back().rank = frame == 0 ? 0 : frames_[frame - 1].rank + (frames_[frame - 1].same_as < 0);
  if (!view->defect.empty()) return result_of(frame);
  if (view->same_as >= 0) {
    repeat(*view);
    frame_timing_.add(milliseconds_since(begin));
    return result_of(frame);
  }
  const double ahead_ms = view->detect_ms;
  detected_ms_ = 0;
  waiting_.push_back(std::move(view));
  go_through_waiting();
  detect_timing_.add(ahead_ms + detected_ms_);
  frame_timing_.add(ahead_ms + milliseconds_since(begin));
  return result_of(frame);
}

// It says nothing that its original did not, and has the pose of that. A picture that stays for longer than
// the one before it did says that the rig stands.
void Odometry::repeat(const View& view) {
  if (record_of(view.frame).segment >= 0) tell_posed(view.frame);
  if (!previous_ || !(previous_->interval > 0)) return;
  if (view.timestamp - previous_->view->timestamp > kStandsAfter * previous_->interval) {
    previous_->interval = 0;
  }
}

// A start puts the views after it back in front of those that wait.
void Odometry::go_through_waiting() {
  while (!waiting_.empty()) {
    ViewPtr view = std::move(waiting_.front());
    waiting_.pop_front();
    if (tracking()) {
      if (marks_.is_in_doubt()) view = detected(view);
      track(std::move(view));
      if (std::exchange(marks_are_new_, false)) forget_marks();
      continue;
    }
    view = detected(view);
    if (std::exchange(marks_are_new_, false)) {
      if (segments_.empty()) {
        start_without_marks(view);
        continue;
      }
      forget_marks();
    }
    if (!segments_.empty() && relocalise(view)) continue;
    if (!turn_on_the_spot(view)) explain_blindness(*view);
    if (options_.starts_worlds) start(view);
  }
}

FramePosed Odometry::pose_of(int number) const {
  const FrameRecord& frame = record_of(number);
  const Map& map = segments_[frame.segment].map;
  return {number, frame.segment, present_pose(frame, map).inverse(), covariance_of(frame, map)};
}

FrameResult Odometry::result_of(int number) const {
  const FrameRecord& frame = record_of(number);
  if (frame.segment >= 0) return {number, TrackingState::kTracking, pose_of(number), {}};
  const TrackingState state = segments_.empty() ? TrackingState::kStarting : TrackingState::kLost;
  return {number, state, std::nullopt, frame.reason.empty() ? waiting_reason() : frame.reason};
}

std::string Odometry::waiting_reason() const {
  const bool tried = starter_ && !starter_->last_reason().empty();
  return tried ? "no start yet: " + starter_->last_reason() : "no start yet: too little motion so far";
}

// Where nothing can be seen, that is the reason, and not what comes of it.
void Odometry::explain_blindness(const View& view) {
  if (auto reason = blindness(view)) frames_[view.frame].reason = *reason;
}

// Marks included.
ViewPtr Odometry::with_corners(const ViewPtr& view) const {
  if (!maker_) return view;
  return view->frame >= evenly_from_ ? maker_->detected_evenly(view) : maker_->detected(view);
}

ViewPtr Odometry::detected(const ViewPtr& view) {
  const ViewPtr found = with_corners(view);
  detected_ms_ += found->detect_ms - view->detect_ms;
  if (found->detected() && marks_.watch(*found)) {
    marks_are_new_ = true;
    observer_->marks_found({view->frame, marks_.part_of(*found)});
  }
  return marks_.without(found);
}

// Before anything has started all views are gone through again, as if marks had been known.
void Odometry::start_without_marks(const ViewPtr& view) {
  const std::vector<WaitingView> views = starter_->views();
  starter_.emplace(rig_, options_);
  marks_.hold_from(views.empty() ? view->frame : views.front().frame);
  waiting_.push_front(view);
  for (auto it = views.rbegin(); it != views.rend(); ++it) {
    if (it->view) waiting_.push_front(it->view);
  }
}

// What was taken for points of the scene, and bent it.
void Odometry::forget_marks() {
  give_up_marks(marks_, &segment().map);
  if (!tracking()) return;
  std::erase_if(previous_->pose.matches,
                [&](const PointMatch& m) { return marks_.covers(m.camera, m.pixel); });
  adjust_all();
}

// Of the newest posed view, from the frame before it, or after it where time is gone through backwards.
void Odometry::learn_velocity() {
  const int before_it = previous_->view->frame + (goes_back_ ? 1 : -1);
  if (before_it < 0 || before_it >= frames()) return;
  const FrameRecord& last = record_of(before_it);
  if (last.segment != world()) return;
  const Rigid3 before = present_pose(last, segment().map);
  previous_->velocity = previous_->pose.rig_from_world * before.inverse();
  previous_->interval = previous_->view->timestamp - last.timestamp;
}

void Odometry::set_anchor(int keyframe) {
  local_ = make_local_map(segment().map, segment().views, rig_, keyframe, kLocalReach);
  std::vector<double> distances;
  for (const LocalPoint& p : local_.points) {
    if (p.in_anchor)
      distances.push_back(
          (segment().map.keyframes[keyframe].rig_from_world * segment().map.tracks[p.track].position).norm());
  }
  anchor_distance_ = median_of(&distances);
}

// Of a frame that had no pose, and of those that repeat it.
void Odometry::tell_posed(int frame) {
  const int original = frame;
  do {
    ++posed_;
    observer_->frame_posed(pose_of(frame));
  } while (++frame < frames() && frames_[frame].same_as == original);
}

// Whether a pose is about where the motion before leads. Large patches fit at places where turning and moving
// make up for each other.
bool Odometry::goes_on(const Localisation& pose, const View& view) const {
  if (!(previous_->interval > 0)) return true;
  const auto place = [](const Rigid3& rig_from_world) { return rig_from_world.inverse().translation; };
  const Eigen::Vector3d expected = place(moved_on(*previous_, view));
  const double step = (expected - place(previous_->pose.rig_from_world)).norm();
  return (place(pose.rig_from_world) - expected).norm() <=
         kMostSwerve * step + kMostTremble * anchor_distance_;
}

// Rotation of the rig since a view before as the motion of the whole image tells it.
Rigid3 Odometry::turned(const View& before_view, const View& view) const {
  const CoarseMotion motion = coarse_motion(before_view.cameras[0], view.cameras[0]);
  const Camera& camera = rig_.camera(0);
  const Eigen::Vector2d center(0.5 * (camera.width - 1), 0.5 * (camera.height - 1));
  Ray before, after;
  if (!camera.ray(center, &before) || !camera.ray(center + motion.shift.cast<double>(), &after)) return {};
  const Eigen::Quaterniond cam_rotation =
      Eigen::AngleAxisd(motion.angle, after.direction) *
      Eigen::Quaterniond::FromTwoVectors(before.direction, after.direction);
  return camera.rig_from_cam * Rigid3{cam_rotation, Eigen::Vector3d::Zero()} * camera.rig_from_cam.inverse();
}

// Where the motion before leads by the time of a view.
Rigid3 Odometry::moved_on(const Previous& from, const View& view) {
  constexpr double kMostIntervals = 4;  // beyond them nothing is known of it
  const Rigid3& still = from.pose.rig_from_world;
  if (from.interval == 0) return still;
  const double intervals = (view.timestamp - from.view->timestamp) / from.interval;
  return part_of(from.velocity, std::clamp(intervals, 0.0, kMostIntervals)) * still;
}

Localisation Odometry::follow(const View& view) {
  localiser_.set_motion(previous_->pose.motion);
  return localiser_.follow(segment().map, segment().views, local_, view, moved_on(*previous_, view));
}

// Most frames are where their predecessors lead and need no corners.
Localisation Odometry::localise(ViewPtr* view) {
  Localisation pose = follow(**view);
  if (convincing(pose)) return pose;
  *view = detected(*view);
  return search(**view);
}

Localisation Odometry::search(const View& view) {
  const Rigid3 still = previous_->pose.rig_from_world, moving = moved_on(*previous_, view);
  Localisation best;
  for (int attempt = 0; attempt < 4; ++attempt) {
    const Rigid3 predicted = attempt == 1   ? turned(*previous_->view, view) * still
                             : attempt == 3 ? still
                                            : moving;
    const Effort effort = attempt == 0 ? Effort::kNear : attempt == 3 ? Effort::kBlind : Effort::kWide;
    Localisation pose =
        localiser_.localise(segment().map, segment().views, local_, view, predicted, range_of(effort, view));
    if (convincing(pose)) return pose;
    if (!best.ok || (pose.ok && pose.matches.size() > best.matches.size())) best = std::move(pose);
  }
  return options_.departures.blur ? search_blurred(view, std::move(best)) : best;
}

// What moved while it was exposed shows its corners no more, but larger things still.
Localisation Odometry::search_blurred(const View& view, Localisation best) {
  const Rigid3 turned_on = turned(*previous_->view, view) * previous_->pose.rig_from_world;
  for (const Rigid3& predicted : {best.ok ? best.rig_from_world : moved_on(*previous_, view), turned_on}) {
    Localisation pose =
        localiser_.follow(segment().map, segment().views, local_, view, predicted, Focus::kBlurred);
    if (!anchor_is_in_sight(pose) || !goes_on(pose, view)) continue;
    if (convincing(pose)) return pose;
    if (pose.matches.size() > best.matches.size()) best = std::move(pose);
  }
  return best;
}

// The newest posed view becomes a key frame; `next` is where the rig is now, null: not known.
double Odometry::promote_previous(const Rigid3* next) {
  previous_->view = detected(previous_->view);
  if (rig_.scans()) {
    previous_->pose.motion =
        motion_of(previous_->view->frame, previous_->pose.rig_from_world, goes_back_ ? nullptr : next);
  }
  return promote(previous_->view, previous_->pose, Adjusting::kNow);
}

void Odometry::track(ViewPtr view) {
  const std::string failure = go_on(&view);
  if (!failure.empty()) return lose(view, failure);
  // With the key frame that makes another one old enough: what key frames cost is no other frame's.
  look_about(static_cast<int>(segment().map.keyframes.size()) - kPlaceAge);
  drop_second_looks();
}

// Poses the view by the map, to which it or the one before it is added where that is due. Says why it has no
// pose; nothing where it has one.
std::string Odometry::go_on(ViewPtr* view) {
  Localisation pose = localise(view);
  if (!believable(pose) && previous_may_help()) {
    promote_previous(nullptr);
    pose = localise(view);
  }
  if (!believable(pose)) {
    return pose.ok ? fmt::format("{} of the {} points seen last were found again", pose.matched_with_anchor,
                                 pose.visible_in_anchor)
                   : pose.reason;
  }
  follow_scan(**view, &pose);
  const bool needed = needs_keyframe(pose);
  if (needed && previous_is_due()) {
    Rigid3 step = pose.rig_from_world * previous_->pose.rig_from_world.inverse();
    step.translation *= promote_previous(&pose.rig_from_world);
    const Rigid3 predicted = step * previous_->pose.rig_from_world;
    pose = localiser_.follow_again(segment().map, segment().views, local_, **view, predicted, pose.matches);
    if (!convincing(pose)) pose = localise(view);
    if (!believable(pose)) return "the new key frame does not see what the frame sees";
    follow_scan(**view, &pose);
  } else if ((needed || has_moved_on((*view)->frame, pose)) && is_due(pose)) {
    *view = detected(*view);
    promote(*view, pose, needed ? Adjusting::kNow : Adjusting::kSoon);
    pose.rig_from_world = segment().map.keyframes.back().rig_from_world;
  }
  accept(*view, std::move(pose));
  return {};
}

// A blurred view makes a poor key frame: a better one is waited for, while most of the anchor is in sight.
bool Odometry::is_due(const Localisation& pose) {
  return !pose.is_blurred() || !convincing(pose) ||
         pose.visible_in_anchor < kMostlyInSight * pose.anchor_points;
}

bool Odometry::previous_is_due() const {
  return is_due(previous_->pose) && segment().map.keyframes.back().frame != previous_->view->frame;
}

// Where track was found again the anchor may be an old key frame, which saw much that is hidden now.
bool Odometry::previous_may_help() const {
  return previous_is_due() && needs_keyframe(previous_->pose);
}

bool Odometry::has_moved_on(int frame, const Localisation& pose) const {
  const MapKeyFrame& anchor = segment().map.keyframes[local_.anchor];
  const Rigid3 step = pose.rig_from_world * anchor.rig_from_world.inverse();
  const bool nearer = motion_watch_.is_much();
  return options_.departures.keyframes &&
         std::abs(rank_of(frame) - rank_of(anchor.frame)) >= (nearer ? 1 : kMinKeyFrameGap) &&
         step.translation.norm() > (nearer ? kNearerBaseline : kKeyFrameBaseline) * anchor_distance_;
}

bool Odometry::needs_keyframe(const Localisation& pose) const {
  const double enough = std::min<double>(options_.min_matches, kKeyFrameShare * pose.anchor_points);
  if (pose.matched_with_anchor < enough) return true;
  const Eigen::Matrix3d position =
      covariance_in_world(pose.rig_from_world, pose.covariance).topLeftCorner<3, 3>();
  const double semi_axis =
      std::sqrt(kEllipsoid90 * Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(position).eigenvalues()[2]);
  return semi_axis > mean_keyframe_distance();
}

// Over those that are still at hand.
double Odometry::mean_keyframe_distance() const {
  const std::vector<MapKeyFrame>& keyframes = segment().map.keyframes;
  const size_t first = keyframes.size() - std::min<size_t>(keyframes.size() - 1, kKeptViews);
  double sum = 0;
  for (size_t i = first; i < keyframes.size(); ++i) {
    sum += (keyframes[i].rig_from_world * keyframes[i - 1].rig_from_world.inverse()).translation.norm();
  }
  return sum / static_cast<double>(keyframes.size() - first);
}

// Returns the factor by which that rescaled the map.
double Odometry::promote(const ViewPtr& view, const Localisation& pose, Adjusting adjusting) {
  const double rescaled = segment().map.rescaled;
  correct_scans(world(), first_scan_to_correct());
  mapper_.add_keyframe(view, pose, adjusting, &segment().map, &segment().views);
  const double factor = segment().map.rescaled / rescaled;
  rescale_frames(world(), factor);
  if (!goes_back_) {
    doubt_relief();
    refine_calibration(world(), false);
    follow_errors(segment().map);
  }
  const int keyframe = static_cast<int>(segment().map.keyframes.size()) - 1;
  Localisation at_keyframe = pose;
  at_keyframe.rig_from_world = segment().map.keyframes[keyframe].rig_from_world;
  record(view->frame, at_keyframe, keyframe);
  previous_->pose.rig_from_world = present_pose(frames_[previous_->view->frame], segment().map);
  if (!goes_back_) settle_behind(keyframe, factor);
  set_anchor(keyframe);
  return factor;
}

// What comes with a new key frame: it is told, and what is far behind it is not adjusted any more.
void Odometry::settle_behind(int keyframe, double rescaled) {
  const int frame = segment().map.keyframes[keyframe].frame;
  observer_->keyframe_added({frame, world(), keyframe});
  forget_old_views();
  const int first_moved = settled_before_;
  const int settled = keyframe - options_.window;
  if (keyframe >= options_.global_until && settled >= 0) {
    settle_until(segment().map.keyframes[settled + 1].frame);
  }
  observer_->map_adjusted({world(), first_moved, frame, rescaled});
}

void Odometry::scale_pose(double factor, FrameRecord* frame) {
  const Eigen::Vector<double, 6> unit{factor, factor, factor, 1, 1, 1};
  frame->rig_from_keyframe.translation *= factor;
  frame->covariance = unit.asDiagonal() * frame->covariance * unit.asDiagonal();
}

// What hangs on key frames follows a new scale of their map.
void Odometry::rescale_frames(int segment, double factor) {
  if (factor == 1) return;
  for (FrameRecord& frame : frames_) {
    if (frame.segment == segment) scale_pose(factor, &frame);
  }
  rescale_track(segment, factor);
}

// What is known beside frames of a map that has a new scale.
void Odometry::rescale_track(int segment, double factor) {
  map_covariance_.rescale(segment, factor);
  if (!tracking() || segment != active_) return;
  previous_->pose.rig_from_world.translation *= factor;  // the world is the first key frame
  previous_->pose.motion.velocity.head<3>() *= factor;
  previous_->pose.motion.acceleration.head<3>() *= factor;
  previous_->velocity.translation *= factor;
}

void Odometry::forget_old_views() {
  std::vector<KeyFrameView>& views = segment().views;
  const int newest = static_cast<int>(views.size()) - 1;
  const int looked_for = newest - kFollowedFor;
  if (const auto part = looked_for < 0 ? std::nullopt : unexplained_part(segment().map, looked_for, rig_)) {
    motion_watch_.add(segment().map.keyframes[looked_for].frame, *part);
  }
  drop_dead_features(looked_for, false);
  const int forgotten = newest - kKeptViews;
  if (forgotten < 0) return;
  views[forgotten] = KeyFrameView{};
  drop_dead_features(forgotten, true);
}

void Odometry::drop_dead_features(int keyframe, bool for_good) {
  if (keyframe < 0) return;
  raysfm::drop_dead_features(keyframe, for_good, &segment().map, &segment().views[keyframe]);
}

// Keeps how well the poses of the active world are known; `map` is its map.
void Odometry::follow_errors(const Map& map) {
  if (map_covariance_.is_due(map)) map_covariance_.measure(rig_, refiner_.deviations(), map, world());
}

// Of the tangent of a frame's world_from_rig, in its map.
Matrix6d Odometry::covariance_of(const FrameRecord& frame, const Map& map) const {
  const Matrix6d by_calibration = map_covariance_.by_calibration(
      frame.segment, map.keyframes[frame.keyframe].frame, frame.rig_from_keyframe);
  return covariance_in_world(present_pose(frame, map), frame.covariance + by_calibration);
}

// The covariance of a pose that hangs on a key frame, from the one with points held fixed.
Matrix6d Odometry::with_map(int segment, int keyframe, const Rigid3& rig_from_world,
                            const Matrix6d& points_fixed) const {
  const MapKeyFrame& k = segments_[segment].map.keyframes[keyframe];
  return map_covariance_.of(segment, k.frame, rig_from_world * k.rig_from_world.inverse(), points_fixed);
}

void Odometry::record(int number, const Localisation& pose, int keyframe) {
  record(number, pose, keyframe, with_map(world(), keyframe, pose.rig_from_world, pose.covariance));
}

void Odometry::record(int number, const Localisation& pose, int keyframe, const Matrix6d& covariance) {
  FrameRecord& frame = frames_[number];
  const bool is_new = frame.segment < 0;
  frame.segment = world();
  frame.keyframe = keyframe;
  frame.rig_from_keyframe = pose.rig_from_world * segment().map.keyframes[keyframe].rig_from_world.inverse();
  frame.covariance = covariance;
  frame.place_held = false;
  frame.reason.clear();
  frame.matches.clear();
  for (const PointMatch& m : pose.matches) frame.matches.push_back(m);
  if (is_new && !goes_back_) tell_posed(number);
}

// By its matches, as the map is now. A key frame keeps the pose that the adjustment gave it; its covariance
// is renewed.
void Odometry::pose_again(int number) {
  FrameRecord* frame = &frames_[number];
  if (frame->segment < 0 || frame->matches.empty()) return;
  const Map& map = segments_[frame->segment].map;
  const MapKeyFrame& keyframe = map.keyframes[frame->keyframe];
  Rigid3 pose = present_pose(*frame, map);
  if (rig_.scans()) localiser_.set_motion(present_motion(number));
  Matrix6d points_fixed;
  if (!localiser_.refine(map, frame->matches, &pose, &points_fixed)) return;
  if (keyframe.frame != number) frame->rig_from_keyframe = pose * keyframe.rig_from_world.inverse();
  frame->covariance = with_map(frame->segment, frame->keyframe, pose, points_fixed);
}

// The pose is final, now that later key frames have improved the points.
void Odometry::settle(int number) {
  pose_again(number);
  frames_[number].matches = std::vector<TrackPixel>();  // frees the memory, which {} does not
}

void Odometry::settle_until(int end) {
  for (; settled_before_ < end; ++settled_before_) settle(settled_before_);
}

// A posed view and what the rig did since the one before it.
Odometry::Previous Odometry::following(const Previous& before, const ViewPtr& view, Localisation pose) {
  const Rigid3 velocity = pose.rig_from_world * before.pose.rig_from_world.inverse();
  return {view, std::move(pose), velocity, view->timestamp - before.view->timestamp};
}

void Odometry::accept(const ViewPtr& view, Localisation pose) {
  record(view->frame, pose, local_.anchor);
  previous_ =
      previous_ ? following(*previous_, view, std::move(pose)) : Previous{view, std::move(pose), {}, 0};
}

OdometryTimings Odometry::timings() const {
  return {detect_timing_,         start_timing_,           localiser_.match_timing,
          localiser_.pose_timing, localiser_.align_timing, mapper_.keyframe_timing,
          mapper_.adjust_timing,  calibrate_timing_,       frame_timing_};
}

}  // namespace raysfm
