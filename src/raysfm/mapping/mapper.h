#pragma once

#include <span>
#include <vector>

#include "raysfm/bundle/bundle_adjuster.h"
#include "raysfm/bundle/local_bundle.h"
#include "raysfm/core/paged_memory.h"
#include "raysfm/core/timer.h"
#include "raysfm/geometry/triangulation.h"
#include "raysfm/mapping/localiser.h"
#include "raysfm/mapping/options.h"
#include "raysfm/mapping/scale_keeper.h"
#include "raysfm/matching/across_matcher.h"
#include "raysfm/matching/guided_matcher.h"
#include "raysfm/scene/map.h"

namespace raysfm {

// Key frames of a map above which frames do not wait for all of it to be adjusted.
constexpr size_t kLargeMap = 200;

// Error of an inlier of a map at most: standard deviations, which are pixels of the octave.
constexpr double kInlierError = 2.0;

// How a map follows a calibration that has changed: in a few steps of the poses by the points that hold them
// best, which the others follow, where the change is small; in two series of a few steps, the inliers found
// anew in between, by those points or by all; until it converges; or, where loops hold what is weakest, until
// poses no longer move by more than is known of them.
enum class Adaption { kThinned, kTwoSeriesThinned, kTwoSeries, kToTheEnd, kUntilSettled };

// What looks nearly the same as a map: through a narrow lens one inside out (mapping/relief.h), of a plane
// the other motion that it looks the same by (mapping/planar_twin.h).
enum class Rival { kInsideOut, kPlanarTwin };

// What more key frames say of a map that is hardly told from its rivals: it stays, it stays beyond doubt, or
// one of them took its place.
enum class Relief { kStays, kSurelyStays, kReversed };

// How soon a map is to be adjusted to a new key frame: now, where frames could not be posed without it.
enum class Adjusting { kNow, kSoon };

// Grows a map by key frames (LBA09 2.4 and 2.5). Owns scratch memory.
class Mapper {
 public:
  Mapper(const TrackingRig& rig, const OdometryOptions& options) : rig_(rig), options_(options) {}

  // Makes a posed frame the newest key frame: takes over its matches, follows the tracks that have no
  // position yet, triangulates, starts new tracks at the remaining corners, adjusts the end of the map: along
  // with the next one, where it may be soon.
  void add_keyframe(const ViewPtr& view, const Localisation& pose, Adjusting adjusting, Map* map,
                    std::vector<KeyFrameView>* views);

  // Follows the tracks without a position from key frame `from` to key frame `to` along their epipolar lines,
  // each in its own camera. Does nothing where images of `from` are not there any more. `motion`: of the
  // rig at `to`.
  void follow_tracks(int from, int to, const RigMotion& motion, const View& view, Map* map,
                     std::span<const KeyFrameView> views);

  // The tail end of a key frame whose matches are in the map: starts tracks at the remaining corners, finds
  // tracks without a position in the other cameras of the same instant, and appends its view.
  void complete_keyframe(const ViewPtr& view, int keyframe, const RigMotion& motion, Map* map,
                         std::vector<KeyFrameView>* views);

  // Triangulates the tracks of a key frame that have no position, where parallax and reprojection allow.
  void triangulate_tracks(int keyframe, Map* map);

  // Adjusts the newest key frames and their points in two stages (2.5).
  void adjust_locally(Map* map);

  // Adjusts everything until it converges.
  void adjust_globally(Map* map);

  // Holds a map of few key frames against its rivals. Where one fits clearly better it is the map now,
  // adjusted; else nothing changes.
  Relief choose_relief(Map* map);

  // Adjusts everything, where parts of it fit together badly: each part by itself first. The unit of length
  // may change, where nothing tells it.
  void adjust_hierarchically(Map* map);

  // Adjusts the key frames from `first` on to cameras that are no longer those that the map was adjusted
  // with.
  void adapt_to_cameras(int first, Adaption how, Map* map);

  // After an adjustment of everything: once more, by a loss that suits the noise as it is (MM estimation,
  // Yohai 1987). The unit of length stays.
  void adjust_to_noise(Map* map);

  // A few steps for a large map whose parts were brought together: poses by the points that hold them best.
  // The unit of length stays.
  void adjust_thinned(Map* map);

  // Measures the scale of the map and its standard deviation, where rays have different origins.
  // `deviations`: how well the calibration is known, as of window_covariance(); empty: by heart.
  void measure_scale(ScaleEffort effort, Map* map, std::span<const Rig> deviations = {});

  StageTiming keyframe_timing, adjust_timing;

 private:
  struct Candidate {
    double negative_parallax;
    int track;
  };

  struct WorldFromCam {
    bool is_known = false;
    Eigen::Matrix3d rotation;
    Eigen::Vector3d translation;
  };

  void follow_in(int camera, int from, int to, const RigMotion& motion, const View& view, Map* map,
                 std::span<const KeyFrameView> views);
  void find_across(const ViewPtr& view, int keyframe, Map* map, std::vector<KeyFrameView>* views);
  bool join_across(int keyframe, const AcrossMatch& match, Map* map);
  const WorldFromCam& world_from_cam(const Map& map, int keyframe, int camera);
  void forget_cams();
  float gather_rays(const Map& map, const Track& track);
  bool triangulate_track(const Map& map, Track* track);
  void refit_surfaces(const Map& map, std::vector<KeyFrameView>* views);
  void choose_window(const Map& map, int first_observed);
  void reserve_observations(const Map& map);
  void gather(const Map* map, int first_observed, int first_free);
  BundleProblem window_problem(const Map& map);
  ScalePrior present_extent() const;
  bool take_rival(Rival rival);
  double weigh_rival(Rival rival, const Map& map);
  RobustLoss loss_of(const BundleProblem& problem) const;
  void adapt_window(const BundleProblem& problem, Adaption how);
  void scatter(int first_free, Map* map);
  bool is_adjustment_due(Adjusting adjusting, int keyframes) const;
  void adjust(const LocalWindow& window, const BundleOptions& first, const BundleOptions& second, Map* map);
  void release_scratch(const Map& map);

  static const BundleOptions kAdjustment;  // until it converges

  const TrackingRig& rig_;
  const OdometryOptions& options_;
  GuidedMatcher matcher_;
  AcrossMatcher across_;
  std::vector<AcrossMatch> across_matches_;
  std::vector<int> same_place_;
  BundleAdjuster adjuster_;
  std::vector<int> followed_;             // features of the anchor that are looked for
  std::vector<Eigen::Vector3d> on_rays_;  // kOnRay for each
  std::vector<PointProjection> seen_on_rays_;
  std::vector<PatchQuery> queries_;
  std::vector<GuidedMatch> matches_;
  std::vector<Eigen::Vector2f> starts_;
  std::vector<AlignedPatch> alignments_;
  std::vector<Ray> rays_;
  std::vector<WorldFromCam> world_from_cams_;  // of each key frame, as far as they were asked for
  std::vector<size_t> known_cams_;
  std::vector<Candidate> candidates_;

  // The window as flat arrays, and where its elements came from.
  struct Window {
    LargeArray<int> keyframes, pose_of_keyframe;
    LargeArray<Rigid3> poses;
    LargeArray<uint8_t> free;
    LargeArray<Eigen::Vector3d> points;
    LargeArray<int> tracks, point_of_track;
    LargeArray<BundleObservation> observations;
    LargeArray<ObservedRay> rays;
    LargeArray<float> sigmas;
    LargeArray<TrackObservation> sources;
    LargeArray<uint8_t> inliers;
  };
  Window window_;
};

constexpr float kTrackSpacing = 4.0f;  // pixels of the octave, between the features of a key frame

// Makes what a key frame sees an observation of a track. False, changing nothing, where residuals are angular
// and the pixel has no ray.
bool observe(const TrackingRig& rig, const TrackPixel& seen, int keyframe, Map* map);

// Moves observation `feature` of a key frame; false, changing nothing, as above.
bool move_observation(const TrackingRig& rig, int feature, const Eigen::Vector2f& pixel, int octave,
                      MapKeyFrame* keyframe);

// Makes the rays of a key frame anew, where residuals are angular; without a ray, an observation is no
// inlier.
void renew_rays(const TrackingRig& rig, MapKeyFrame* keyframe);

// Starts a new track at every corner that is at least `spacing` pixels of its octave from the features of the
// key frame.
void start_tracks(const TrackingRig& rig, const View& view, float spacing, int keyframe, Map* map);

}  // namespace raysfm
