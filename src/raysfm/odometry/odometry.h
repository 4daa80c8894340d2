#pragma once

#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "raysfm/core/events.h"
#include "raysfm/odometry/localiser.h"
#include "raysfm/odometry/mapper.h"
#include "raysfm/odometry/options.h"
#include "raysfm/odometry/relocaliser.h"
#include "raysfm/odometry/starter.h"
#include "raysfm/odometry/view_maker.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

struct OdometryTimings {
  StageTiming detect, start, match, pose, align, keyframe, adjust, frame;
};

// Trajectory and map of a calibrated rig from its views in time order (LBA09 2.7):
//   1. three views start a map;
//   2. each further view is matched with the map and posed;
//   3. when too little is matched or the pose is too uncertain, the view before becomes a key frame: new
//   points,
//      local adjustment.
// Where track is lost, the key frames are searched for again while a new segment tries to start.
class Odometry {
 public:
  // Valid options; the views hold an image of each camera of the rig. They may lack their corners where
  // `maker`, which outlives this, is given to detect them when they are needed.
  Odometry(Rig rig, const OdometryOptions& options, EventSink events, const ViewMaker* maker = nullptr);

  void process(ViewPtr view);

  // No more views: the last call. Adjusts everything when told so. Every frame has a pose or a reason.
  Reconstruction finish(bool final_global);

  OdometryTimings timings() const;
  const TrackingRig& rig() const { return rig_; }
  int posed() const { return posed_; }
  bool tracking() const { return previous_.has_value(); }
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
    Matrix6d covariance = Matrix6d::Zero();  // tangent of rig_from_world
    std::vector<TrackPixel> matches;         // until the pose is settled
  };
  struct SegmentState {
    Map map;
    std::vector<KeyFrameView> views;
    StartSummary start;
    std::string end_reason = "end of input";
  };
  // The newest posed view: where the next prediction starts, and the next key frame.
  struct Previous {
    ViewPtr view;
    Localisation pose;
    Rigid3 velocity;      // rig now from rig `interval` ago
    double interval = 0;  // seconds, > 0; 0: no velocity
  };

  SegmentState& segment() { return segments_.back(); }

  ViewPtr detected(const ViewPtr& view);
  void start(const ViewPtr& view);
  void begin_segment(Start start, const std::vector<WaitingView>& views);
  void pose_start_frames(const Start& start, const std::vector<WaitingView>& views);
  void pose_earlier_frames(const std::vector<WaitingView>& views, int first_view);
  void pose_copies(const std::vector<WaitingView>& views);
  bool pose_near(const View& view, const LocalMap& local, const Rigid3& predicted, bool sure,
                 Rigid3* rig_from_world);
  void pose_between(const Start& start, const WaitingView& waiting, int view, const LocalMap& local);
  void track(ViewPtr view);
  Rigid3 moved_on(const View& view) const;
  Localisation localise(ViewPtr* view);
  Localisation search(const View& view);
  Rigid3 turned(const View& view) const;
  bool relocalise(const ViewPtr& view);
  bool take_up(const ViewPtr& view, int keyframe, const Rigid3& rig_from_world);
  bool needs_keyframe(int frame, const Localisation& pose) const;
  double promote(const ViewPtr& view, const Localisation& pose);
  void rescale_frames(int segment, double factor);
  void accept(const ViewPtr& view, Localisation pose);
  void set_anchor(int keyframe);
  void record(int frame, const Localisation& pose, int keyframe);
  void settle(int segment, FrameRecord* frame);
  void settle_frames_of(int keyframe);
  void lose(const ViewPtr& view, const std::string& reason);
  void forget_old_views();
  void drop_dead_features(int keyframe, bool for_good);
  double mean_keyframe_distance() const;
  void release_views();
  double hand_over_map(int number, Reconstruction* out);
  int hand_over_summary(int number, Reconstruction* out) const;
  void reserve_observations(Reconstruction* out) const;
  Reconstruction hand_over();
  void tell(Event::Level level, std::string message) const;

  OdometryOptions options_;
  TrackingRig rig_;
  EventSink events_;
  const ViewMaker* maker_;
  Localiser localiser_;
  Mapper mapper_;
  Relocaliser relocaliser_;  // of the newest segment
  std::optional<Starter> starter_;
  std::deque<SegmentState> segments_;
  std::deque<FrameRecord, SlabAllocator<FrameRecord>> frames_;
  std::optional<Previous> previous_;
  LocalMap local_;
  int anchor_points_ = 0;       // of local_ seen by its key frame
  double anchor_distance_ = 0;  // median distance of these points from it
  int posed_ = 0;
  StageTiming detect_timing_, start_timing_, frame_timing_;
  double detected_ms_ = 0;  // during the present frame
};

}  // namespace raysfm
