#pragma once

#include <optional>
#include <string>
#include <vector>

#include "raysfm/core/timer.h"
#include "raysfm/mapping/options.h"
#include "raysfm/matching/guided_matcher.h"
#include "raysfm/robust/absolute_pose.h"
#include "raysfm/scene/map.h"
#include "raysfm/views/rolling_shutter.h"

namespace raysfm {

// A map point as it will be looked for: the patch of `feature` in `keyframe`.
struct LocalPoint {
  int track = 0;
  int keyframe = 0;
  int feature = 0;
  bool in_anchor = false;  // the anchor sees the track
};

// The points that frames near a key frame may see, sorted by key frame.
struct LocalMap {
  int anchor = 0;  // the key frame
  std::vector<LocalPoint> points;
};

constexpr int kLocalReach = 10;  // other key frames whose points are looked for

// The points of the anchor, then those of the `reach` other key frames whose points its cameras would see
// most of, whenever they were taken: a place seen before is recognised while the drift is smaller than the
// search.
LocalMap make_local_map(const Map& map, std::span<const KeyFrameView> views, const TrackingRig& rig,
                        int anchor, int reach);

// The key frame of whose points the rig would see most from a pose; the newest of equals, and -1 where it
// would see none that there are images of.
int keyframe_in_sight(const Map& map, std::span<const KeyFrameView> views, const TrackingRig& rig,
                      const Rigid3& rig_from_world);

// What was found of a query: a GuidedMatch or an AlignedPatch.
template <typename Found>
TrackPixel seen_at(const PatchQuery& query, const Found& found) {
  return {query.track, static_cast<uint8_t>(query.camera), static_cast<uint8_t>(found.octave), found.pixel};
}

// The same for a point of a local map.
struct PointMatch : TrackPixel {
  bool in_anchor = false;  // the local map's anchor sees the track
};

// How far the search for map points goes before a first pose is known.
struct SearchRange {
  float radius_px = 0;  // of the region of interest about a predicted place
  int coarse_points =
      0;  // of the local map that are matched with corners, about; the others wait for the pose
};

// How the search widens.
enum class Effort : uint8_t { kNear, kWide, kBlind };

// Of images of that size.
SearchRange range_of(Effort effort, const View& view);

// What patches of a view are compared in.
enum class Focus : uint8_t {
  kSharp,    // the octave in which they are as large as they were, or a finer one
  kBlurred,  // a coarser one too, where that shows nothing: the view may have moved while it was exposed
};

// Pose of a frame against the map, or why there is none.
struct Localisation {
  bool ok = false;
  std::string reason;
  Rigid3 rig_from_world;
  RigMotion motion;                        // of the rig, where it is known
  Matrix6d covariance = Matrix6d::Zero();  // of the tangent of rig_from_world
  double sigma_px = 0;
  std::vector<PointMatch> matches;  // the inliers
  int visible = 0;                  // points of the local map that a camera of the frame should see
  int anchor_points = 0;            // of what was looked for: points that the anchor sees
  int visible_in_anchor = 0;        // those of them that are visible
  int matched_with_anchor = 0;      // of these, those found again
  int blurred = 0;                  // of the matches: seen in coarser octaves alone

  bool is_blurred() const { return 2 * blurred > static_cast<int>(matches.size()); }
};

// Whether so many points were found, and such a part of those of the anchor that should be visible, that
// track goes on from there. Older key frames may show what is hidden now; what the anchor saw a moment ago
// must be there still.
bool believable(const Localisation& pose);
// The same, and so many that a wider search is not worth its time.
bool convincing(const Localisation& pose);
// The same after a loss, when the guess behind it may be wrong. From another side much is hidden, and while
// the camera shook much has gone out of sight; but the more points agree, the less it is by chance.
bool recognised(const Localisation& pose, const OdometryOptions& options);
// By one rule or the other: where track is taken on from a posed view to those beside it that had no pose,
// neither how it got lost nor a wrong guess speaks against it.
bool followed(const Localisation& pose, const OdometryOptions& options);
// Whether enough of the anchor's points are in sight: a pose from large patches alone may be one by chance,
// far from the anchor.
bool anchor_is_in_sight(const Localisation& pose);

// A key frame as if it had been localised, with its own observations.
Localisation seen_by_keyframe(const MapKeyFrame& keyframe, const Map& map);

// Pose of a frame (LBA09 2.3): match with the map guided by a predicted pose, RANSAC, sub-pixel alignment,
// refinement with covariance. Owns scratch memory.
class Localiser {
 public:
  Localiser(const TrackingRig& rig, const OdometryOptions& options) : rig_(rig), options_(options) {}

  // Of the rig at the views that come next: what it does to them where a shutter rolls.
  void set_motion(const RigMotion& motion) { motion_ = motion; }

  // Some points of the local map are matched with corners for a first pose; then all are aligned where that
  // pose expects them.
  Localisation localise(const Map& map, std::span<const KeyFrameView> views, const LocalMap& local,
                        const View& view, const Rigid3& predicted_rig_from_world, const SearchRange& range);

  // The same without corners, for a view that is near its prediction: patches of some points are aligned for
  // a first pose.
  Localisation follow(const Map& map, std::span<const KeyFrameView> views, const LocalMap& local,
                      const View& view, const Rigid3& predicted_rig_from_world, Focus focus = Focus::kSharp);

  // The same for a view that was localised before the map changed. What was found in it is not looked for
  // again, and tells the first pose.
  Localisation follow_again(const Map& map, std::span<const KeyFrameView> views, const LocalMap& local,
                            const View& view, const Rigid3& predicted_rig_from_world,
                            std::span<const PointMatch> found);

  // Pose from matches that are corners still, with outliers among them; none where they do not determine it.
  // Says nothing of visible points. `about`: whereabouts, looked at with a rolling shutter alone.
  // `stream`: of random numbers.
  Localisation pose_from_matches(const Map& map, std::span<const TrackPixel> matches, uint64_t stream,
                                 const Rigid3& about = {});

  // The pose again, from the same matches and the present positions of the points. False, changing nothing,
  // where they no longer determine it.
  bool refine(const Map& map, std::span<const TrackPixel> matches, Rigid3* rig_from_world,
              Matrix6d* covariance);

  StageTiming match_timing, pose_timing, align_timing;

 private:
  void predict(const Map& map, std::span<const KeyFrameView> views, const LocalMap& local, const View& view,
               const Rigid3& rig_from_world, float radius, int max_points);
  void predict_in(int camera, const Map& map, std::span<const KeyFrameView> views, const LocalMap& local,
                  const View& view, const Rigid3& rig_from_world, float radius);
  void work_out_offsets(const Map& map, const Rigid3& about);
  void make_observations(const Map& map, const Rigid3& about);
  PoseObservations observations() const { return {points_, pixels_, cameras_, rays_, sigmas_}; }
  bool estimate(const Rigid3* prior, uint64_t stream, double max_error_px);
  void align_some(int coarser, int most, const Map& map, std::span<const KeyFrameView> views,
                  const LocalMap& local, const View& view, const Rigid3& rig_from_world);
  Localisation align_all(const Map& map, std::span<const KeyFrameView> views, const LocalMap& local,
                         const View& view, std::span<const PointMatch> found = {},
                         Focus focus = Focus::kSharp);
  bool align(const Map& map, std::span<const KeyFrameView> views, const LocalMap& local, const View& view,
             std::span<const PointMatch> found, Focus focus);
  void clear_open();
  void open(size_t query, const View& view, int coarser);
  void align_open(std::span<const KeyFrameView> views, const View& view, FinerOctaves finer);
  void align_queries(std::span<const KeyFrameView> views, const View& view,
                     std::span<const PointMatch> found);
  void align_blurred(std::span<const KeyFrameView> views, const View& view);
  void count(const LocalMap& local, bool aligned, Localisation* out);
  bool refine_estimate();

  const TrackingRig& rig_;
  const OdometryOptions& options_;
  RigMotion motion_;
  GuidedMatcher matcher_;
  PoseEstimator estimator_;
  PoseEstimate estimate_;
  int step_ = 1;  // every so manieth point of the local map is looked for
  std::vector<PatchQuery> queries_;
  std::vector<GuidedMatch> corners_;
  std::vector<Eigen::Vector2f> starts_;
  std::vector<AlignedPatch> alignments_;  // by query
  std::vector<TrackPixel> known_;         // places found before, by track and camera
  std::vector<PatchQuery> open_queries_;  // those without
  std::vector<int> open_;                 // their indices
  std::vector<AlignedPatch> open_alignments_;
  std::vector<TrackPixel> seen_;    // what observations are made of
  std::vector<int> found_queries_;  // the queries that these were found for
  std::vector<int> kept_;           // which of them the observations are
  std::vector<int> of_camera_;      // which of them a camera saw, and there:
  std::vector<Eigen::Vector3d> in_rig_;
  std::vector<Eigen::Vector2f> camera_offsets_, offsets_;  // of a rolling shutter
  std::vector<Eigen::Vector3d> points_;
  std::vector<Eigen::Vector2d> pixels_;
  std::vector<int> cameras_;
  std::vector<ObservedRay> rays_;   // where residuals are angular
  std::vector<float> sigmas_;       // pixels
  std::vector<uint8_t> counted_;    // by point of the local map
  std::vector<int> aligned_point_;  // of the local map
  std::vector<uint8_t> aligned_coarser_;
  std::vector<PointMatch> aligned_;
};

}  // namespace raysfm
