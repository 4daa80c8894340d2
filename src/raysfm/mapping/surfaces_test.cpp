#include "raysfm/views/surfaces.h"

#include <gtest/gtest.h>

#include <functional>

#include "raysfm/mapping/mapper.h"
#include "raysfm/matching/guided_matcher.h"
#include "support/panel_world.h"

namespace raysfm {
namespace {

// 110 degrees wide; a second one looks back.
TrackingRig wide_rig(int cameras) {
  Rig rig;
  for (int c = 0; c < cameras; ++c) {
    Camera camera;
    camera.model = Radtan::from_parameters({110, 112, 160, 119, 0, 0, 0, 0, 0});
    camera.width = 320;
    camera.height = 240;
    camera.rig_from_cam = {exp_so3({0, 3.1 * c, 0.1}), {0.2 - 0.4 * c, 0.05, 0}};
    rig.cameras.push_back(camera);
  }
  return TrackingRig(std::move(rig));
}

// A key frame that sees points of a surface, given by the depth of a ray of camera 0, all over its image.
struct Seen {
  Map map;
  KeyFrameView view;

  Seen(const TrackingRig& rig, const std::function<double(const Ray&)>& depth_along) {
    MapKeyFrame& keyframe = map.keyframes.emplace_back();
    keyframe.rig_from_world = Rigid3{exp_so3({0.3, -0.2, 0.1}), {1, 2, 3}};
    Rng rng(3);
    for (int i = 0; i < 700; ++i) {
      const Eigen::Vector2f pixel(rng.uniform(20, 300), rng.uniform(20, 220));
      Ray ray;
      EXPECT_TRUE(rig.camera(0).ray(pixel.cast<double>(), &ray));
      const Eigen::Vector3d in_cam = ray.origin + depth_along(ray) * ray.direction;
      Track& track = map.tracks.emplace_back();
      track.position = keyframe.rig_from_world.inverse() * (rig.camera(0).rig_from_cam * in_cam);
      track.triangulated = true;
      observe(rig, {i, 0, 0, pixel}, 0, &map);
    }
    const ViewPtr image = testing_support::as_view(testing_support::flat_image(320, 240, 128), 0);
    view = make_keyframe_view(image, keyframe, rig);
  }

  Eigen::Vector3d normal(int feature) const {
    const Eigen::Matrix<double, 3, 2> surface = view.point_jacobians[feature].cast<double>();
    return surface.col(0).cross(surface.col(1)).normalized();
  }
};

const Eigen::Vector3d kFloor = Eigen::Vector3d(0.2, 1, 0.5).normalized();  // across the floor, camera's frame

double to_floor(const Ray& ray) {
  return kFloor.dot(Eigen::Vector3d(0, 0, 4) - ray.origin) / kFloor.dot(ray.direction);
}

// Walls before and behind each other, with an edge between.
double to_walls(const Ray& ray) {
  return (ray.direction.x() < 0 ? 2 : 4) / ray.direction.z();
}

double in_front(double distance) {
  return distance > 0 && distance < 100 ? distance : 100;
}

class SurfacesOf : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Cameras, SurfacesOf, testing::Values(1, 2));

TEST_P(SurfacesOf, AFloorIsFoundToBeOne) {
  const TrackingRig rig = wide_rig(GetParam());
  Seen seen(rig, [](const Ray& ray) { return in_front(to_floor(ray)); });
  fit_surfaces(rig, seen.map, 0, &seen.view);
  int floor = 0, right = 0;
  for (int f = 0; f < 700; ++f) {
    const Eigen::Vector3d direction = seen.view.directions[f].cast<double>();
    if (!(direction.dot(kFloor) > 0.4)) continue;
    ++floor;
    right += std::abs(seen.normal(f).dot(kFloor)) > 0.995;
  }
  EXPECT_GT(floor, 200);
  EXPECT_GT(right, 0.97 * floor);
}

TEST(Surfaces, AnEdgeIsNoSlope) {
  const TrackingRig rig = wide_rig(2);
  Seen seen(rig, to_walls);
  fit_surfaces(rig, seen.map, 0, &seen.view);
  int right = 0;
  for (int f = 0; f < 700; ++f) right += std::abs(seen.normal(f).z()) > 0.97;
  EXPECT_GT(right, 0.97 * 700);
}

// The deformation of a patch is the derivative of the way pixel -> floor -> other pixel.
TEST(Surfaces, PatchesOfAFloorAreDeformedAsTheFloorIs) {
  const TrackingRig rig = wide_rig(2);
  Seen seen(rig, [](const Ray& ray) { return in_front(to_floor(ray)); });
  fit_surfaces(rig, seen.map, 0, &seen.view);
  const Rigid3 moved{exp_so3({0.02, -0.1, 0.05}), {0.5, -0.2, -0.6}};
  const auto transfer = [&](const Eigen::Vector2d& pixel) {
    Ray ray;
    Eigen::Vector2d out(0, 0);
    EXPECT_TRUE(rig.camera(0).ray(pixel, &ray));
    EXPECT_TRUE(rig.camera(0).project(moved * (ray.origin + to_floor(ray) * ray.direction), &out));
    return out;
  };
  int tried = 0;
  double error = 0;
  for (int f = 0; f < 700; ++f) {
    const Eigen::Vector3d direction = seen.view.directions[f].cast<double>();
    const Eigen::Vector2d pixel = seen.view.pixels[f].cast<double>();
    Ray ray;
    ASSERT_TRUE(rig.camera(0).ray(pixel, &ray));
    PatchQuery query;
    if (!(direction.dot(kFloor) > 0.4) ||
        !predict_patch(rig, seen.view, f, to_floor(ray), 0, moved, seen.view.camera_view(f), &query)) {
      continue;
    }
    Eigen::Matrix2d slope;
    for (int c = 0; c < 2; ++c) {
      const Eigen::Vector2d step = 0.01 * Eigen::Vector2d::Unit(c);
      slope.col(c) = (transfer(pixel + step) - transfer(pixel - step)) / 0.02;
    }
    const Eigen::Matrix2d warp =
        query.keyframe_from_target.cast<double>() / static_cast<double>(octave_side(query.octave));
    error += (warp * slope - Eigen::Matrix2d::Identity()).norm();
    ++tried;
  }
  ASSERT_GT(tried, 50);
  EXPECT_LT(error / tried, 0.02);
}

}  // namespace
}  // namespace raysfm
