#include "raysfm/views/surfaces.h"

#include <Eigen/Core>
#include <algorithm>

#include "raysfm/geometry/ray.h"

namespace raysfm {
namespace {

// Part of the image's longer side, and neighbours at most. 0.05 to 0.1 and 6 to 16 do about as well.
constexpr float kNeighbourhood = 0.06f;
constexpr int kMostNeighbours = 10;
constexpr float kFirstLook = 0.4f;  // part of the neighbourhood, which changes no result
// Relative, of inverse depths: by how much points of one surface are off its plane. Tried from 0.02 to 0.15;
// the scale of a mirror camera is best up to 0.05.
constexpr float kOffPlane = 0.04f;
constexpr float kSlope = 1;  // standard deviation of a surface's slope before anything is seen of it
constexpr int kRounds = 4;
constexpr double kNearest = 0.1;  // of the point's depth; what is nearer is on another surface

// What a camera of a key frame sees that has a position.
struct SeenPoints {
  std::vector<int> features;
  std::vector<Eigen::Vector2f> pixels;
  std::vector<Eigen::Vector3d> points;  // in the camera's frame
  FeatureGrid grid;

  SeenPoints(const TrackingRig& rig, const Map& map, const MapKeyFrame& keyframe, int camera) {
    const Rigid3 cam_from_world = rig.cam_from_rig(camera) * keyframe.rig_from_world;
    for (int f = 0; f < keyframe.size(); ++f) {
      const int track = keyframe.tracks[f];
      if (keyframe.cameras[f] != camera || track < 0 || !keyframe.inliers[f]) continue;
      if (!map.tracks[track].triangulated) continue;
      features.push_back(f);
      pixels.push_back(keyframe.pixels[f]);
      points.push_back(cam_from_world * map.tracks[track].position);
    }
    grid.build(pixels, rig.camera(camera).width, rig.camera(camera).height);
  }
};

// Points near that of a feature as the feature's ray sees them, each in a lane: places in the plane across
// the ray at unit depth, and inverse depths over that of the feature, less 1. Lanes that are left over are
// zero, which says nothing of a slope.
struct Neighbours {
  static constexpr int kLanes = (kMostNeighbours + 3) / 4 * 4;
  using Lanes = Eigen::Array<float, kLanes, 1>;
  Lanes x, y, nearer;

  void clear() { x.setZero(), y.setZero(), nearer.setZero(); }
};

class SurfaceFit {
 public:
  SurfaceFit(const SeenPoints& seen, float radius) : seen_(seen), radius_(radius) {}

  // Turns the surface about a point into its plane.
  void turn(int point, const Ray& ray, Eigen::Matrix<float, 3, 2>* jacobian) {
    const Eigen::Matrix<double, 2, 3> tangents = tangent_rows(ray.direction);
    collect(point, ray, tangents);
    const Eigen::Matrix2d across = tangents * jacobian->cast<double>();
    const Eigen::Matrix<double, 3, 2> facing = tangents.transpose() * across;
    *jacobian = (facing - ray.direction * (slope().cast<double>().transpose() * across)).cast<float>();
  }

 private:
  void collect(int point, const Ray& ray, const Eigen::Matrix<double, 2, 3>& tangents) {
    // Mostly there are more than enough near by.
    look_within(kFirstLook * radius_, point);
    if (near_.size() < kMostNeighbours) look_within(radius_, point);
    const size_t count = std::min<size_t>(near_.size(), kMostNeighbours);
    std::nth_element(near_.begin(), near_.begin() + static_cast<ptrdiff_t>(count), near_.end());
    neighbours_.clear();
    const double depth = ray.direction.dot(seen_.points[point] - ray.origin);
    for (size_t i = 0; i < count; ++i) {
      const Eigen::Vector3d offset = seen_.points[near_[i].second] - ray.origin;
      const double along = ray.direction.dot(offset);
      if (along <= kNearest * depth) continue;
      const auto lane = static_cast<Eigen::Index>(i);
      const Eigen::Vector2d place = tangents * offset / along;
      neighbours_.x[lane] = static_cast<float>(place.x());
      neighbours_.y[lane] = static_cast<float>(place.y());
      neighbours_.nearer[lane] = static_cast<float>(depth / along - 1);
    }
  }

  void look_within(float radius, int point) {
    near_.clear();
    const Eigen::Vector2f pixel = seen_.pixels[point];
    seen_.grid.for_each_in(pixel, radius, [&](int j) {
      if (j != point) near_.push_back({(seen_.pixels[j] - pixel).squaredNorm(), j});
    });
  }

  // nearer = slope . place on the plane, by least squares that neighbours on other surfaces hardly enter.
  Eigen::Vector2f slope() const {
    constexpr float kRidge = (kOffPlane * kOffPlane) / (kSlope * kSlope);
    const auto& [x, y, nearer] = neighbours_;
    Eigen::Vector2f slope(0, 0);
    for (int round = 0; round < kRounds; ++round) {
      const float scale = round == 0 ? 4 * kOffPlane : kOffPlane;
      const Neighbours::Lanes off = (nearer - slope.x() * x - slope.y() * y) / scale;
      const Neighbours::Lanes weight = 1 / (1 + off * off);
      const Neighbours::Lanes weighted_x = weight * x, weighted_y = weight * y;
      const float xx = (weighted_x * x).sum() + kRidge, yy = (weighted_y * y).sum() + kRidge,
                  xy = (weighted_x * y).sum();
      const float right_x = (weighted_x * nearer).sum(), right_y = (weighted_y * nearer).sum();
      slope = Eigen::Vector2f(yy * right_x - xy * right_y, xx * right_y - xy * right_x) / (xx * yy - xy * xy);
    }
    return slope;
  }

  const SeenPoints& seen_;
  float radius_;
  std::vector<std::pair<float, int>> near_;  // squared distance in the image, point
  Neighbours neighbours_;
};

}  // namespace

void fit_surfaces(const TrackingRig& rig, const Map& map, int keyframe, KeyFrameView* view) {
  for (int c = 0; c < rig.size(); ++c) {
    const SeenPoints seen(rig, map, map.keyframes[keyframe], c);
    SurfaceFit fit(seen, kNeighbourhood * static_cast<float>(rig.camera(c).longer_side()));
    for (int i = 0; i < static_cast<int>(seen.features.size()); ++i) {
      const int f = seen.features[i];
      fit.turn(i, {view->origins[f].cast<double>(), view->directions[f].cast<double>()},
               &view->point_jacobians[f]);
    }
  }
}

}  // namespace raysfm
