#pragma once

#include <array>
#include <compare>
#include <optional>
#include <set>
#include <span>
#include <vector>

#include "raysfm/features/descriptor.h"
#include "raysfm/places/described.h"
#include "raysfm/robust/absolute_pose.h"
#include "raysfm/scene/map.h"
#include "raysfm/views/tracking_rig.h"

namespace raysfm {

// Corner `corner` of what was asked about shows the point of track `track` of the map.
struct CornerOfTrack {
  int corner = 0;
  int track = 0;
};

// A place of a map recognised in what a rig sees at one instant.
struct RecognisedPlace {
  int keyframe = 0;  // of the map
  Rigid3 rig_from_world;
  Matrix6d covariance = Matrix6d::Zero();  // of the tangent of rig_from_world
  std::vector<CornerOfTrack> matches;      // that agree with the pose
  // Logarithm to base 10 of the number of poses that would be agreed on so well by chance, among matches that
  // are all wrong (a contrario; Moisan and Stival 2004). Where track ended, what the pose then leads to
  // counts too.
  double log10_false_alarms = 0;
  // Where track ended: the part of the cells of the image, of those where the pose sees its points, in which
  // one is found.
  double found = 0;
};

// What was seen last before track was lost: what is seen next is most like it, and may be seen from far
// aside.
struct TrackEnd {
  int world = 0, keyframe = 0;      // the last key frame
  std::vector<TrackPixel> corners;  // of points of that world, each of one of the last key frames that see it
  std::vector<UprightDescriptor> upright;
};

// A part of the image of a camera: what agrees within one counts once.
struct ImageCell {
  int camera = 0, column = 0, row = 0;
  auto operator<=>(const ImageCell&) const = default;
};
ImageCell cell_of(const TrackingRig& rig, int camera, const Eigen::Vector2f& pixel);

// Recognises places by what their corners look like and, for any camera, by whether one pose explains where
// they are. Owns scratch memory.
class PlaceMatcher {
 public:
  explicit PlaceMatcher(const TrackingRig& rig) : rig_(rig) {}

  // Whether a view shows the place of a described key frame. `seed` and `stream` draw the samples.
  std::optional<RecognisedPlace> recognise(const DescribedCorners& seen, const Map& map, int keyframe,
                                           uint64_t seed, uint64_t stream);
  // The same of where track ended in a map, by what is upright.
  std::optional<RecognisedPlace> recognise(const DescribedCorners& seen, const Map& map, const TrackEnd& end,
                                           uint64_t seed, uint64_t stream);

 private:
  void match(const DescribedCorners& seen, const Map& map, int keyframe);
  void match(const DescribedCorners& seen, const Map& map, const TrackEnd& end);
  template <typename LookAbout>
  std::optional<RecognisedPlace> find_pose(const DescribedCorners& seen, const Map& map, uint64_t seed,
                                           uint64_t stream, int least, const LookAbout& look_about);
  void begin_to_look(const DescribedCorners& seen, const Map& map, bool aside_too);
  void look_about(const DescribedCorners& seen, const Map& map, int keyframe, const Rigid3& rig_from_world);
  void look_about(const DescribedCorners& seen, const Map& map, const TrackEnd& end,
                  const Rigid3& rig_from_world);
  template <typename Differing>
  int nearest_corner(int camera, const Eigen::Vector2d& pixel, int most, const Differing& differing) const;
  template <typename Differing>
  void look_aside(int camera, const Eigen::Vector2d& pixel, int most, const Differing& differing);
  template <typename Differing>
  void look_for(const Map& map, int track, const Rigid3& rig_from_world, int most,
                const Differing& differing);
  PoseObservations observations(const DescribedCorners& seen, const Map& map);
  std::vector<CornerOfTrack> keep_inliers();
  bool has_rival(const DescribedCorners& seen, const Map& map, const PoseOptions& options,
                 std::vector<CornerOfTrack> others);
  std::set<ImageCell> cells_of_matches(const DescribedCorners& seen) const;
  double log10_false_alarms(const DescribedCorners& seen, int matched) const;

  // Where points were looked for, and where, as far aside on each of four sides, something like them was.
  struct Search {
    bool aside_too = false;
    std::set<ImageCell> looked_for;
    std::array<std::set<ImageCell>, 4> aside;
  };
  double log10_found_by_chance(const std::set<ImageCell>& known, const std::set<ImageCell>& all_found) const;

  const TrackingRig& rig_;
  PoseEstimator estimator_;
  PoseEstimate estimate_, rival_;
  std::vector<CornerOfTrack> matches_;
  std::vector<DescriptorMatch> alike_;
  std::vector<FeatureGrid> grids_;  // of the corners, by camera
  std::vector<std::vector<int>> corners_of_camera_;
  std::vector<uint8_t> corner_taken_, track_taken_;
  Search search_;
  std::vector<Eigen::Vector3d> points_;
  std::vector<Eigen::Vector2d> pixels_;
  std::vector<int> cameras_;
  std::vector<ObservedRay> rays_;
  std::vector<float> sigmas_;
};

// Logarithm to base 10 of the expected number of samples of `matches` wrong matches, triples unless told,
// whose pose, or whatever follows from a sample, agrees with `agreeing` of them, where one agrees by chance
// with probability `chance`.
double log10_chance_poses(int matches, int agreeing, double chance, int sample = 3);

}  // namespace raysfm
