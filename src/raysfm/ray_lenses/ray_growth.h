#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "raysfm/bundle/bundle_adjuster.h"
#include "raysfm/calibration/rig_parameters.h"
#include "raysfm/ray_lenses/ray_reconstruction.h"
#include "raysfm/robust/absolute_pose.h"
#include "raysfm/robust/three_view_start.h"

namespace raysfm {

// Of residuals in pixels.
inline constexpr RobustLoss kRayLoss{RobustLoss::Kind::kHuber, 0.5};

// What poses an image: points that agree, and which part of all that it sees.
struct Agreement {
  int points;
  double part;
};

// One number per image or observation of a problem to that of the tracks.
struct RayProblemPart {
  std::vector<Camera> cameras;
  std::vector<int> image, point, observation;  // of the tracks, by number in the problem
  std::vector<Rigid3> poses;
  std::vector<uint8_t> pose_is_free, inlier;
  std::vector<Eigen::Vector3d> points;
  std::vector<BundleObservation> observations;

  BundleProblem problem() {
    return {.cameras = cameras,
            .rig_from_world = poses,
            .pose_is_free = pose_is_free,
            .points = points,
            .point_is_fixed = {},
            .observations = observations,
            .is_inlier = inlier,
            .rays = {},
            .lenses = {},
            .sigmas = {},
            .scale_prior = {}};
  }
};

// A reconstruction along rays as it grows: a start of three images (ray_growth_start), the others by the
// points that they share (ray_growth), and in between the lens by what the residuals say of it
// (ray_growth_lens).
class RayGrowth {
 public:
  RayGrowth(const PointTracks& tracks, const Camera& guess, const RayOptions& options);

  // `avoided`: images two of which make no start, one mark each.
  bool start(std::span<const uint8_t> avoided);
  void go_on_from(const RayReconstruction& start);
  void complete();
  void take_sigma();
  RayReconstruction& result() { return r_; }

 private:
  void grow();
  void settle(int rounds);
  bool drop_doubtful();
  double agreeing_part(int image) const;
  std::span<const Agreement> agreements() const;
  Eigen::VectorXd guess_sigma() const;
  double effect_on_rim(int parameter, const Eigen::Vector3d& rim) const;
  Eigen::Vector3d direction_of_rim() const;
  void cast_rays();
  bool start_along_video();
  bool start_anywhere(std::span<const uint8_t> avoided);
  int last_of_start(int first) const;
  ThreeViewStart three_view_start(const std::array<int, 3>& images, std::vector<int>* points) const;
  void take(const std::array<int, 3>& images, const ThreeViewStart& start, std::span<const int> points);
  int next_image() const;
  bool pose(int image);
  void place_points();
  RayProblemPart part() const;
  void adjust();
  double step_lens();
  bool try_lens(const Eigen::VectorXd& values);
  bool place(std::vector<Ray>* rays, Eigen::Vector3d* point) const;
  bool stopped() const { return options_.stopped && options_.stopped(); }

  const PointTracks& tracks_;
  const RayOptions& options_;
  const RigParameters parameters_;
  RayReconstruction r_;
  std::vector<std::vector<int>> of_image_, of_point_;  // observations
  Eigen::VectorXd values_, sigma_;                     // of the parameters: present, and of the guess
  double max_error_;                                   // of an inlier, pixels
  std::vector<uint8_t> has_ray_;                       // one per observation, through the guess
  std::vector<uint8_t> tried_;                         // one per image
  size_t agreement_ = 0;              // the one of agreements() that images are posed by at present
  std::vector<int> dropped_;          // how often each image was
  std::vector<Eigen::Vector3d> ray_;  // one per observation, through the guess
  BundleAdjuster adjuster_;
  PoseEstimator estimator_;
};

}  // namespace raysfm
