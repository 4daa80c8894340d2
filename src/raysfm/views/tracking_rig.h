#pragma once

#include <span>
#include <utility>
#include <vector>

#include "raysfm/camera/camera.h"
#include "raysfm/camera/observed_ray.h"
#include "raysfm/camera/pixel_curvature.h"
#include "raysfm/camera/pixel_finder.h"

namespace raysfm {

// What is minimised: the difference of pixels, or the angle between rays (LBA09 3.2), which every camera has.
enum class ErrorMeasure : uint8_t {
  kAuto,  // pixels where all cameras of the rig can project, else angles
  kPixel,
  kAngular,       // angles, each weighted to what it is in pixels where it was observed
  kAngularPlain,  // angles as they are, as in the paper
  kPaper,         // pixels where every camera projects, else angles as they are
};

// How a camera sees a point.
struct PointProjection {
  bool in_image = false;  // else the rest says nothing
  Eigen::Vector2d pixel;
  Eigen::Matrix<double, 2, 3> jacobian;  // by the point in the camera's frame
};

// A rig with what every stage of the pipeline asks of it, worked out once. Nothing after this asks which kind
// of cameras there are.
class TrackingRig {
 public:
  // At least one camera, with its size. kPixel needs cameras that can project: see validate_error().
  explicit TrackingRig(Rig rig, ErrorMeasure measure = ErrorMeasure::kAuto);

  const Rig& rig() const { return rig_; }
  const std::vector<Camera>& cameras() const { return rig_.cameras; }
  const Camera& camera(int c) const { return rig_.cameras[c]; }
  int size() const { return static_cast<int>(rig_.cameras.size()); }

  const Rigid3& cam_from_rig(int c) const { return cam_from_rig_[c]; }
  double pixels_per_radian(int c) const { return pixels_per_radian_[c]; }
  double pixels_per_radian() const;  // the least of all cameras

  // Pixel at which camera c sees a point, inside its image or not.
  bool find(int c, const Eigen::Vector3d& point_in_cam, Eigen::Vector2d* pixel,
            Eigen::Matrix<double, 2, 3>* jacobian = nullptr) const {
    return finders_[c].find(point_in_cam, pixel, jacobian);
  }
  // The same; false also outside the image.
  bool see(int c, const Eigen::Vector3d& point_in_cam, Eigen::Vector2d* pixel,
           Eigen::Matrix<double, 2, 3>* jacobian = nullptr) const {
    return find(c, point_in_cam, pixel, jacobian) && rig_.cameras[c].contains(*pixel);
  }

  // The same of many points, several at once where the camera projects.
  void see(int c, std::span<const Eigen::Vector3d> points_in_cam, std::vector<PointProjection>* seen) const;

  const PixelCurvature& curvature(int c) const { return curvatures_[c]; }

  // Residuals are angular (LBA09 3.2); else they are differences of pixels.
  bool angular() const { return angular_; }

  // What observe() weights residuals by.
  AngularWeight weight() const { return weighted_ ? AngularWeight::kPixel : AngularWeight::kNone; }

  // The ray of an observation for angular residuals, scaled so that these are in pixels. False where the
  // pixel sees nothing.
  bool observe(int c, const Eigen::Vector2f& pixel, ObservedRay* ray) const;

  // All rays of all cameras pass one point, so that nothing can tell the scale.
  bool central() const { return central_; }

  // A camera has a rolling shutter.
  bool scans() const { return scans_; }

  // Pairs of cameras (a, b), a != b, where b sees a good part of what is far before a.
  const std::vector<std::pair<int, int>>& common_views() const { return common_views_; }

 private:
  Rig rig_;
  bool angular_ = false, weighted_ = true, central_ = true, scans_ = false;
  std::vector<Rigid3> cam_from_rig_;
  std::vector<double> pixels_per_radian_;
  std::vector<PixelFinder> finders_;
  std::vector<PixelCurvature> curvatures_;
  std::vector<std::pair<int, int>> common_views_;
};

// Refuses ErrorMeasure::kPixel for cameras that cannot project, naming the first.
Result<void> validate_error(const Rig& rig, ErrorMeasure measure);

}  // namespace raysfm
