#pragma once

#include <deque>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "raysfm/calibration/calibration_refiner.h"
#include "raysfm/mapping/localiser.h"
#include "raysfm/mapping/mapper.h"
#include "raysfm/mapping/options.h"
#include "raysfm/mapping/starter.h"
#include "raysfm/mapping/turn_tracker.h"
#include "raysfm/odometry/observer.h"
#include "raysfm/places/place_memory.h"
#include "raysfm/places/shared_views.h"
#include "raysfm/scene/reconstruction.h"
#include "raysfm/uncertainty/map_covariance.h"
#include "raysfm/views/fixed_marks.h"
#include "raysfm/views/other_motion.h"
#include "raysfm/views/view_archive.h"
#include "raysfm/views/view_maker.h"

namespace raysfm {

constexpr int kKeptViews = 60;  // key frames whose images are kept
// Key frames after which a track that has no position, and is not seen any more, is given up.
constexpr int kFollowedFor = 2;

// Time of each stage, one entry for each frame that it was needed in. `frame` is all of a frame's but
// decoding.
struct OdometryTimings {
  StageTiming detect, start, match, pose, align, keyframe, adjust, calibrate, frame;
};

enum class TrackingState : uint8_t {
  kStarting,  // no world yet
  kTracking,  // the frame has a pose
  kLost,      // it has none; old places are looked for, while a new world tries to start
};

// What is known of a frame once it was pushed.
struct FrameResult {
  int frame = 0;  // counts the frames pushed, from 0
  TrackingState state = TrackingState::kStarting;
  std::optional<FramePosed> pose;
  std::string reason;  // why it has no pose, which it may get yet when a world starts; empty where it has one
};

// A focal length that is another one from a frame on; pixels.
struct SeenZoom {
  int frame = 0;
  double before = 0, after = 0;
};

// The newest view and where it shows points of the map, for whoever looks on.
struct NewestView {
  struct Match {
    int camera = 0;
    Eigen::Vector2f pixel = Eigen::Vector2f::Zero();
    std::vector<Eigen::Vector2f> before;  // where the newest key frames saw the point, newest first
  };
  ViewPtr view;                // null: there is none yet
  std::vector<Match> matches;  // none while nothing is tracked
};

// Trajectory and map of a calibrated rig from its views in time order (LBA09 2.7):
//   1. three views start a map;
//   2. each further view is matched with the map and posed;
//   3. when too little is matched or the pose is too uncertain, the view before becomes a key frame: new
//   points,
//      local adjustment.
// Where track is lost, all places of all worlds are looked for while a new world tries to start; as long as
// the rig only turns, its orientation is known meanwhile. Places that are seen again close loops, and join
// worlds.
class Odometry {
 public:
  // Valid options. The views may lack their corners where `maker` is given to detect them when they are
  // needed. It and the observer outlive this; either may be null.
  Odometry(Rig rig, const OdometryOptions& options, TrackerObserver* observer = nullptr,
           const ViewMaker* maker = nullptr);
  Odometry(const Odometry&) = delete;  // its parts refer to each other
  Odometry& operator=(const Odometry&) = delete;

  // Worlds of earlier runs, before the first view: see TrackerOptions.
  void know(std::vector<Map> worlds);

  // The next view: view->frame counts those before it, its timestamp is above theirs, and it holds an image
  // of each camera of the rig unless it has a defect or repeats an earlier one, the newest that did not.
  FrameResult process(ViewPtr view);

  // No more views: the last call. Adjusts everything when told so. Every frame has a pose or a reason.
  // `maps` as Tracker::finish() says.
  Reconstruction finish(bool final_adjustment, std::vector<Map>* maps = nullptr);

  // What is known now.
  Reconstruction snapshot() const;

  // Poses of frames before it do not move any more, but by a final adjustment, by a calibration that is
  // refined and with the scale of a rig.
  int first_movable_frame() const { return settled_before_; }

  // All that decides what comes later, between two views. What is read was written by an Odometry of the same
  // rig and options; it takes the place of what is known. False, and not to be used any more, where the bytes
  // are not such a state.
  void write_state(StateWriter& state) { archive(state); }
  bool read_state(StateReader& state);

  OdometryTimings timings() const;

  // Whether the camera zoomed, as far as what was measured of the calibration tells; before finish().
  std::optional<SeenZoom> lens_change();

  // The newest frame when a rolling shutter was found that nobody told; -1: none was. Frames between key
  // frames keep what was known of it when they came.
  int shutter_found_at() const { return shutter_found_at_; }
  // The newest frame when the lenses of a world of many key frames changed by more than its map can follow;
  // -1: they never did.
  int lens_found_at() const { return lens_found_at_; }
  // Whether one was found that contradicts itself, and is looked for no more.
  bool dropped_shutter() const { return refiner_.dropped_shutter(); }

  // Frames of which a large part does not stand still in their world.
  std::vector<OtherMotion> other_motion() const { return motion_watch_.seen(); }
  NewestView newest_view() const;
  std::vector<ViewPtr> newest_keyframes(int most) const;
  std::vector<CalibrationNumber> calibration() const { return refiner_.numbers(); }
  const TrackingRig& rig() const { return rig_; }
  int posed() const { return posed_; }
  int frames() const { return static_cast<int>(frames_.size()); }

 private:
  // A frame's pose hangs on its key frame, so that it follows every later adjustment of that key frame.
  struct FrameRecord {
    double timestamp = 0;
    std::string name;
    std::string reason;
    int segment = -1;
    int keyframe = -1;
    Rigid3 rig_from_keyframe;
    // Tangent of rig_from_world, the errors of the map included, those of the calibration not.
    Matrix6d covariance = Matrix6d::Zero();
    bool place_held = false;          // as in PosedFrame
    int same_as = -1;                 // an earlier frame, whose record is this one's too; -1: none
    int rank = 0;                     // counts the frames before it that are the same as no other
    std::vector<TrackPixel> matches;  // until the pose is settled

    template <typename A>
    void archive(A& a);
  };
  struct SegmentState {
    Map map;
    std::vector<KeyFrameView> views;
    StartSummary start;
    std::string end_reason = "end of input";
    int calibration = 0;         // number of the one that it began with, or was last adapted to as a whole
    int looked_about = 0;        // key frames before it are places, or will never be
    int newest_place = -1;       // key frame that was looked about from last
    int newest_meeting = -1000;  // key frame that saw a place again
    int relief_due = 4;          // key frames at which its relief is doubted next
    // Of the key frames that were gone through: 1 where it is one of the few that stayed of a second look.
    std::vector<uint8_t> is_known = {};
    bool closed = false;   // parts of its map were brought together since all of it was adjusted
    int joined_into = -1;  // another one has all of it

    template <typename A>
    void archive(A& a);
  };
  // The newest posed view: where the next prediction starts, and the next key frame.
  struct Previous {
    ViewPtr view;
    Localisation pose;
    Rigid3 velocity;      // rig now from rig `interval` ago
    double interval = 0;  // seconds; below 0 where time is gone through backwards; 0: no velocity

    template <typename A>
    void archive(A& a);
  };

  struct TurnedFrame {
    int frame = 0;
    TurnedPose pose;

    template <typename A>
    void archive(A& a);
  };
  // Of frames before any world.
  struct EarlyTurn {
    bool begun = false;
    std::vector<std::vector<TurnedFrame>> turns;  // each without a break

    template <typename A>
    void archive(A& a);
  };

  // What is at hand of a world when the next one starts.
  struct EndedWorld {
    int number = -1;
    std::vector<KeyFrameView> views;
    ViewPtr last;  // that was posed in it
  };

  SegmentState& segment() { return segments_[active_]; }
  const SegmentState& segment() const { return segments_[active_]; }
  int world() const { return active_; }
  bool tracking() const { return previous_.has_value(); }
  // Worlds of a turn have orientations alone; none of them stands beside another kind.
  bool only_turns() const { return !segments_.empty() && segments_[0].map.tracks.empty(); }
  // rig_from_world of a frame, as its key frame stands now in the map of its segment.
  static Rigid3 present_pose(const FrameRecord& frame, const Map& map) {
    return frame.rig_from_keyframe * map.keyframes[frame.keyframe].rig_from_world;
  }

  // Makes the pose of a frame, which stays, hang on another key frame of its map.
  static void hang_on(int keyframe, const Map& map, FrameRecord* frame) {
    frame->rig_from_keyframe = present_pose(*frame, map) * map.keyframes[keyframe].rig_from_world.inverse();
    frame->keyframe = keyframe;
  }

  // What is known of a frame, or of the one that it repeats.
  const FrameRecord& record_of(int frame) const {
    const int original = frames_[frame].same_as;
    return frames_[original < 0 ? frame : original];
  }
  // Frames as a camera that repeats none would count them. Those of earlier runs are below 0.
  int rank_of(int frame) const { return frame < 0 ? frame : frames_[frame].rank; }

  template <typename A>
  void archive(A& a);
  void repeat(const View& view);
  void tell_posed(int frame);
  ViewPtr with_corners(const ViewPtr& view) const;
  ViewPtr detected(const ViewPtr& view);
  ViewPtr prepared(const ViewPtr& view) const;
  void start_without_marks(const ViewPtr& view);
  void forget_marks();
  void go_through_waiting();
  FrameResult result_of(int frame) const;
  std::string waiting_reason() const;
  FramePosed pose_of(int frame) const;
  void explain_blindness(const View& view);
  // odometry_start.cpp:
  void start(const ViewPtr& view);
  std::optional<Start> start_evenly(std::optional<Start> start);
  void begin_segment(Start start, const std::vector<WaitingView>& views);
  void go_on_from(const ViewPtr& view, int keyframe);
  void pose_start_frames(const Start& start, const std::vector<WaitingView>& views);
  void pose_between(const Start& start, const WaitingView& waiting, int view, const LocalMap& local);
  bool pose_near(const View& view, const LocalMap& local, const Rigid3& predicted, bool sure);
  void go_back(const std::vector<WaitingView>& views, int first_view);
  void grow_back(const std::vector<WaitingView>& views, int end, int first_view);
  void pose_earlier_frames(const std::vector<WaitingView>& views, int end, int first_view);
  void reverse_time();
  void hang_on_earlier_keyframes();
  void pose_copies(const std::vector<WaitingView>& views);

  void track(ViewPtr view);
  std::string go_on(ViewPtr* view);
  static Rigid3 moved_on(const Previous& from, const View& view);
  static Previous following(const Previous& before, const ViewPtr& view, Localisation pose);
  Localisation follow(const View& view);
  Localisation localise(ViewPtr* view);
  Localisation search(const View& view);
  Localisation search_blurred(const View& view, Localisation best);
  Rigid3 turned(const View& before, const View& view) const;
  bool goes_on(const Localisation& pose, const View& view) const;
  bool find_again(const ViewPtr& view);
  void begin_turn();
  bool turn_on_the_spot(const ViewPtr& view);
  // odometry_turn.cpp:
  void follow_early_turn(const ViewPtr& view);
  void begin_early_turn();
  void add_to_early_turn(const ViewPtr& view);
  void take_early_turn();
  void turn_from(const TurnedFrame& known, const TurnedFrame& turned, double distance);
  void record_turned(int number, const TurnedPose& pose, int keyframe);
  void begin_turned_worlds();
  void begin_turned_world(const std::vector<TurnedFrame>& turn);
  static bool is_due(const Localisation& pose);
  bool previous_is_due() const;
  bool previous_may_help() const;
  double promote_previous(const Rigid3* next);
  bool relocalise(const ViewPtr& view);
  bool take_up(const ViewPtr& view, int keyframe, const Rigid3& rig_from_world, bool corners_agree);
  bool recall(const ViewPtr& view);
  void take_up_place(const ViewPtr& view, const PlaceRef& where, const DescribedCorners& seen,
                     const RecognisedPlace& place);
  void resume(const ViewPtr& view, int keyframe, Localisation pose);
  void pose_missed(const std::vector<WaitingView>& missed);
  // odometry_scan.cpp:
  RigMotion motion_of(int frame, const Rigid3& rig_from_world, const Rigid3* next = nullptr) const;
  double frame_interval() const;
  RigMotion present_motion(int frame) const;
  RigMotion keyframe_motion(const MapKeyFrame& keyframe) const;
  void follow_scan(const View& view, Localisation* pose);
  int first_scan_to_correct() const;
  void correct_scans(int segment, int first_keyframe);
  RigMotion start_motion(int keyframe) const;
  void pose_frames_again(int segment);
  void refine_start();
  void doubt_relief();
  // odometry_across.cpp:
  EndedWorld end_world();
  std::optional<Meeting> look_across(EndedWorld* ended, const ViewPtr& earliest);
  void begin_from(const ViewPtr& view);
  bool sees_old(ViewPtr view);
  SharedView shared_view(int world, int keyframe) const;
  std::vector<SamePoint> tie(const SharedPoints& shared, std::span<const SharedView> views,
                             EndedWorld* ended);
  void join_ended(EndedWorld ended, const Meeting& meeting);
  // odometry_places.cpp:
  void look_about(int end);
  std::vector<Map*> maps();
  bool is_new_place(int keyframe) const;
  void remember(int keyframe);
  void look_for_ends(int keyframe);
  void remember_end();
  void add_end();
  void close(const Meeting& meeting);
  void join(const Meeting& meeting);
  void fuse(const std::vector<SamePoint>& points);
  void renumber(int segment, int into, const std::vector<int>& keyframes, int first_track);
  void drop_second_looks();
  void rehang_frames(std::span<const uint8_t> goes);
  void adjust_all();
  void all_has_moved();
  bool has_moved_on(int frame, const Localisation& pose) const;
  bool needs_keyframe(const Localisation& pose) const;
  double promote(const ViewPtr& view, const Localisation& pose, Adjusting adjusting);
  void settle_behind(int keyframe, double rescaled);
  static void scale_pose(double factor, FrameRecord* frame);
  void rescale_frames(int segment, double factor);
  void rescale_track(int segment, double factor);
  void refine_calibration(int segment, bool last);
  bool is_bent_by_lens(int segment) const;
  bool take_calibration(int segment, const Rig& better, bool last);
  Adaption adaption(int segment, bool last, bool leads_on) const;
  Adaption whole_adaption(int segment) const;
  void adapt(int segment, int first_keyframe, Adaption how);
  void find_scale(int number, std::span<const Rig> deviations = {});
  void adjust_from(int segment, int first_keyframe, Adaption how);
  void adjust(int segment, const std::function<void(Map*)>& move_keyframes);
  void carry_frames(int segment, const std::vector<Rigid3>& before);
  void accept(const ViewPtr& view, Localisation pose);
  void set_anchor(int keyframe);
  void learn_velocity();
  void record(int frame, const Localisation& pose, int keyframe);
  void record(int frame, const Localisation& pose, int keyframe, const Matrix6d& covariance);
  void follow_errors(const Map& map);
  void finish_covariances();
  Matrix6d covariance_of(const FrameRecord& frame, const Map& map) const;
  Matrix6d with_map(int segment, int keyframe, const Rigid3& rig_from_world,
                    const Matrix6d& points_fixed) const;
  void pose_again(int frame);
  void settle(int frame);
  void settle_until(int frame);
  void lose(ViewPtr view, const std::string& reason);
  void forget_old_views();
  void drop_dead_features(int keyframe, bool for_good);
  double mean_keyframe_distance() const;
  void finish_maps(bool final_adjustment);
  void adjust_finally(int segment);
  void adjust_to_noise(int segment);
  void release_views();
  Reconstruction assemble(std::vector<Map> maps) const;
  Segment summary_of(int number, double scale_sigma) const;
  std::vector<int> numbers_of_segments() const;

  OdometryOptions options_;
  TrackingRig rig_;
  TrackerObserver* observer_;  // never null
  const ViewMaker* maker_;
  Localiser localiser_;
  Mapper mapper_;
  Describer describer_;
  PlaceMemory places_;
  std::vector<Closure> closures_;
  CalibrationRefiner refiner_;
  MapCovariance map_covariance_;
  MotionWatch motion_watch_;
  FixedMarks marks_;
  bool marks_are_new_ = false;                         // during the present frame
  int evenly_from_ = std::numeric_limits<int>::max();  // frame from which on corners are spread evenly
  std::optional<Starter> starter_;
  TurnTracker turner_;  // while track is lost, or does not begin
  EarlyTurn early_turn_;
  std::deque<SegmentState> segments_;
  bool goes_back_ = false;  // through frames before a start
  int active_ = -1;         // segment that is tracked, or was last
  std::deque<FrameRecord, SlabAllocator<FrameRecord>> frames_;
  std::deque<ViewPtr> waiting_;  // for those before them to be gone through
  std::optional<Previous> previous_;
  std::optional<Previous> last_seen_;  // what was the newest posed view when track was lost
  LocalMap local_;
  double anchor_distance_ = 0;  // median distance of these points from it
  int posed_ = 0;
  int settled_before_ = 0;
  int calibration_ = 0;  // counts those taken over
  int shutter_found_at_ = -1, lens_found_at_ = -1;
  StageTiming detect_timing_, start_timing_, calibrate_timing_, frame_timing_;
  double detected_ms_ = 0;  // during the present frame
};

}  // namespace raysfm
