// What the renderer shows through every camera model, against projections.

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "raysfm/camera/pixel_finder.h"
#include "raysfm/geometry/rotation.h"
#include "raysfm/geometry/triangulation.h"
#include "support/test_worlds.h"

namespace raysfm::synth {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr int kSide = 400;  // pixels, of square images
constexpr double kCentre = 0.5 * (kSide - 1);
constexpr double kBallRadius = 0.02;  // radians

// A table with rays that meet in no point: those of an equidistant fisheye, displaced and bent.
NonCentralRayTable bent_table() {
  RayGridData grid;
  grid.max_x = grid.max_y = kSide - 1;
  grid.grid_width = grid.grid_height = 12;
  for (int j = 0; j < 12; ++j) {
    for (int i = 0; i < 12; ++i) {
      const double x = (i - 5.5) / 5, y = (j - 5.5) / 5, r = std::max(std::hypot(x, y), 1e-9);
      grid.directions.emplace_back(x / r * std::sin(r), y / r * std::sin(r) + 0.02 * x, std::cos(r));
      grid.points.emplace_back(0.06 * x, 0.03 * x * y - 0.04 * y, 0.05 * r * r);
    }
  }
  return NonCentralRayTable(grid);
}

Mirror mirror() {
  std::array<double, 15> p = {900, 900, kCentre, kCentre, 0.0125, -1.05, 0.0265, 0.001,
                              0,   0.1, 0,       0,       0,      1,     0.05};
  return Mirror::from_parameters(p);
}

std::vector<CameraModel> models() {
  OCam ocam = OCam::from_parameters([] {
    std::array<double, 21> p{kCentre + 1, kCentre - 2, 1.001, 0.002, -0.001, 102.0, 0, -0.00565};
    p[13] = 1.9e-17;  // the image ends at some 110 degrees
    return p;
  }());
  return {Pinhole{220, 225, kCentre, kCentre},
          Radtan{260, 255, 203, 197, -0.2, 0.04, 0.001, -0.002, 0},
          Rational{260, 255, 203, 197, 0.2, 0.02, 0.001, -0.002, 0, 0.3, 0.03, 0},
          KannalaBrandt{125, 126, kCentre, kCentre, 0, 0, 0, -0.0019451},
          Unified::from_parameters({260, 261, kCentre, kCentre, 1.2, 0, 0, 0, 0}),
          DoubleSphere::from_parameters({150, 151, kCentre, kCentre, -0.2, 0.6}),
          Eucm::from_parameters({150, 151, kCentre, kCentre, 0.62, 1.05}),
          ocam,
          Equirectangular::for_image(kSide, kSide / 2),
          mirror(),
          bent_table()};
}

Camera camera_of(const CameraModel& model) {
  Camera camera;
  camera.model = model;
  camera.width = kSide;
  camera.height = std::holds_alternative<Equirectangular>(model) ? kSide / 2 : kSide;
  return camera;
}

// White balls all around, lit from everywhere, in the dark.
World balls(const Rigid3& world_from_rig, std::vector<Vector3d>* centres_in_rig, ThreadPool& pool) {
  constexpr int kBalls = 80;
  World world = empty_world(pool);
  world.light.ambient = 1;
  Finish white = finish_of(world, Pattern::kPlain);
  white.stains = white.grain = 0;
  for (int i = 0; i < kBalls; ++i) {
    const double y = (2 * i + 1.0) / kBalls - 1, angle = i * std::numbers::pi * (3 - std::sqrt(5.0));
    const double r = std::sqrt(1 - y * y), distance = 2 + 0.3 * (i % 7);
    centres_in_rig->push_back(distance * Vector3d(r * std::cos(angle), y, r * std::sin(angle)));
    world.ellipsoids.push_back({world_from_rig * centres_in_rig->back(), Eigen::Matrix3d::Identity(),
                                Vector3d::Constant(kBallRadius * distance), white});
  }
  return world;
}

cv::Mat red_of(const Image<uint8_t>& bgr) {
  cv::Mat red(bgr.height(), bgr.width() / 3, CV_64F);
  for (int y = 0; y < red.rows; ++y) {
    for (int x = 0; x < red.cols; ++x) red.at<double>(y, x) = bgr.row(y)[3 * x + 2];
  }
  return red;
}

// Centre of mass of the light around a pixel.
Vector2d centroid(const cv::Mat& image, const Vector2d& pixel) {
  constexpr int kReach = 11;
  Vector2d sum = Vector2d::Zero();
  double mass = 0;
  for (int y = -kReach; y <= kReach; ++y) {
    for (int x = -kReach; x <= kReach; ++x) {
      const cv::Point at(static_cast<int>(std::lround(pixel.x())) + x,
                         static_cast<int>(std::lround(pixel.y())) + y);
      const double light = image.at<double>(at);
      sum += light * Vector2d(at.x, at.y);
      mass += light;
    }
  }
  EXPECT_GT(mass, 300) << "light around " << pixel.transpose();
  return sum / mass;
}

// Where the centre of mass of a ball's picture is: the ball is a disc that faces the camera, cut into small
// squares, each of which counts for the area of its projection.
bool project_ball(const PixelFinder& finder, const Vector3d& centre, Vector2d* pixel) {
  constexpr int kSteps = 12;
  const Eigen::Matrix3d to_disc = rotation_to_z(centre.normalized()).transpose();
  const double radius = kBallRadius * centre.norm();
  std::vector<std::vector<Vector2d>> pixels(kSteps + 1, std::vector<Vector2d>(kSteps + 1));
  for (int j = 0; j <= kSteps; ++j) {
    for (int i = 0; i <= kSteps; ++i) {
      const Vector3d offset(2.0 * i / kSteps - 1, 2.0 * j / kSteps - 1, 0);
      if (!finder.find(centre + radius * to_disc * offset, &pixels[j][i])) return false;
    }
  }
  Vector2d sum = Vector2d::Zero();
  double area = 0;
  for (int j = 0; j < kSteps; ++j) {
    for (int i = 0; i < kSteps; ++i) {
      if (std::hypot(2.0 * i + 1 - kSteps, 2.0 * j + 1 - kSteps) > kSteps) continue;
      const Vector2d a = pixels[j + 1][i + 1] - pixels[j][i], b = pixels[j + 1][i] - pixels[j][i + 1];
      const double cell = std::abs(a.x() * b.y() - a.y() * b.x());
      sum += 0.25 * cell * (pixels[j][i] + pixels[j][i + 1] + pixels[j + 1][i] + pixels[j + 1][i + 1]);
      area += cell;
    }
  }
  *pixel = sum / area;
  return true;
}

// 255 where the mask is set all around, far enough from where the camera sees nothing.
cv::Mat inside(const GrayImage& mask) {
  cv::Mat m(mask.height(), mask.width(), CV_8U);
  for (int y = 0; y < m.rows; ++y) std::copy_n(mask.row(y), m.cols, m.ptr(y));
  cv::erode(m, m, cv::Mat::ones(29, 29, CV_8U), {-1, -1}, 1, cv::BORDER_CONSTANT, 0);
  return m;
}

RenderOptions without_noise() {
  RenderOptions options;
  options.noise = 0;
  return options;
}

class EveryModel : public testing::TestWithParam<size_t> {};

TEST_P(EveryModel, ShowsPointsWhereTheyProject) {
  ThreadPool pool(1);
  Camera camera = camera_of(models()[GetParam()]);
  camera.rig_from_cam = {exp_so3({0.3, -0.5, 0.2}), {0.2, -0.1, 0.15}};
  const Rigid3 world_from_rig{exp_so3({-0.4, 1.1, 0.3}), {30, -2, 5}};
  std::vector<Vector3d> centres;
  const World world = balls(world_from_rig, &centres, pool);
  RenderOptions options = without_noise();
  options.samples = 9;  // the balls are but a few pixels wide
  Renderer renderer(world, camera, options, pool);
  cv::Mat image = red_of(renderer.render(stand_at(world_from_rig), 0, 0));
  const cv::Mat valid = inside(renderer.mask());
  const bool panorama = std::holds_alternative<Equirectangular>(camera.model);
  const PixelFinder finder(camera);
  const Rigid3 cam_from_rig = camera.rig_from_cam.inverse();
  int seen = 0;
  for (const Vector3d& centre : centres) {
    const Vector3d in_cam = cam_from_rig * centre;
    Vector2d pixel;
    if (!project_ball(finder, in_cam, &pixel) || !camera.contains(pixel)) continue;
    const cv::Point nearest(static_cast<int>(std::lround(pixel.x())),
                            static_cast<int>(std::lround(pixel.y())));
    if (valid.at<uint8_t>(nearest) && !(panorama && std::abs(pixel.y() - 0.5 * camera.height) > 50)) {
      const Vector2d off = centroid(image, pixel) - pixel;
      EXPECT_LT(off.norm(), 0.12) << model_name(camera.model) << " at " << pixel.transpose() << " off by "
                                  << off.transpose();
      ++seen;
    }
    if (!panorama) cv::circle(image, nearest, 18, cv::Scalar(0), -1);
  }
  EXPECT_GE(seen, 8) << model_name(camera.model);
  if (panorama) return;  // balls near its poles are as wide as the image
  double brightest = 0;
  cv::minMaxLoc(image, nullptr, &brightest, nullptr, nullptr, valid);
  EXPECT_EQ(brightest, 0) << model_name(camera.model) << " shows a ball that it cannot see";
}

// The mask against the rays themselves, and against what is black in a world that is nowhere black.
TEST_P(EveryModel, MaskIsWhereRaysAre) {
  ThreadPool pool(1);
  const Camera camera = camera_of(models()[GetParam()]);
  World world = empty_world(pool);
  world.open_air = true;  // sky all around
  Renderer renderer(world, camera, {}, pool);
  const cv::Mat image = red_of(renderer.render(stand_at({}), 0, 0));
  const GrayImage mask = renderer.mask();
  const auto rays_around = [&](int x, int y, double reach) {
    int rays = 0;
    Ray ray;
    for (int j = -2; j <= 2; ++j) {
      for (int i = -2; i <= 2; ++i) rays += camera.ray({x + 0.5 * reach * i, y + 0.5 * reach * j}, &ray);
    }
    return rays;
  };
  int wrong = 0, wrong_light = 0;
  for (int y = 0; y < camera.height; y += 3) {
    for (int x = 0; x < camera.width; x += 3) {
      const bool sees = mask.row(y)[x] != 0;
      wrong += sees ? rays_around(x, y, 0.25) < 25 : rays_around(x, y, 0.5) == 25;
      wrong_light +=
          sees ? image.at<double>(y, x) < 60 : rays_around(x, y, 1.5) == 0 && image.at<double>(y, x) > 0;
    }
  }
  EXPECT_EQ(wrong, 0) << model_name(camera.model);
  EXPECT_EQ(wrong_light, 0) << model_name(camera.model);
}

std::string name_of(const testing::TestParamInfo<size_t>& info) {
  std::string name(model_name(models()[info.param]));
  std::erase(name, '-');
  return name;
}
INSTANTIATE_TEST_SUITE_P(Cameras, EveryModel, testing::Range<size_t>(0, models().size()), name_of);

// Points seen by two cameras of a rig, triangulated with the rays of both, are where they are.
TEST(Rig, CamerasSeeTheSamePoints) {
  ThreadPool pool(1);
  const Rigid3 world_from_rig{exp_so3({0.1, -0.7, 0.2}), {3, 1, -8}};
  std::vector<Vector3d> centres;
  const World world = balls(world_from_rig, &centres, pool);
  Rig rig{{camera_of(KannalaBrandt{125, 125, kCentre, kCentre, 0, 0, 0, -0.0019451}), camera_of(mirror())}};
  rig.cameras[0].rig_from_cam = {exp_so3({0.1, 0.2, 0}), {-0.3, 0, 0.1}};
  rig.cameras[1].rig_from_cam = {exp_so3({std::numbers::pi / 2, 0, 0}), {0.4, 0.2, 0}};
  std::vector<std::vector<std::pair<int, Ray>>> rays(2);
  for (size_t c = 0; c < 2; ++c) {
    const Camera& camera = rig.cameras[c];
    Renderer renderer(world, camera, without_noise(), pool);
    const cv::Mat image = red_of(renderer.render(stand_at(world_from_rig), 0, 0, static_cast<int>(c)));
    const cv::Mat valid = inside(renderer.mask());
    const PixelFinder finder(camera);
    for (size_t i = 0; i < centres.size(); ++i) {
      Vector2d pixel;
      if (!finder.find(camera.rig_from_cam.inverse() * centres[i], &pixel) || !camera.contains(pixel))
        continue;
      if (!valid.at<uint8_t>(cv::Point(static_cast<int>(std::lround(pixel.x())),
                                       static_cast<int>(std::lround(pixel.y()))))) {
        continue;
      }
      Ray ray;
      ASSERT_TRUE(camera.ray(centroid(image, pixel), &ray));
      rays[c].push_back({static_cast<int>(i),
                         {camera.rig_from_cam * ray.origin, camera.rig_from_cam.rotation * ray.direction}});
    }
  }
  int common = 0;
  for (const auto& [i, a] : rays[0]) {
    for (const auto& [k, b] : rays[1]) {
      if (i != k || angle_between(a.direction, b.direction) < 0.1) continue;
      Vector3d point;
      ASSERT_TRUE(triangulate_midpoint(a, b, &point));
      EXPECT_LT((point - centres[static_cast<size_t>(i)]).norm(), 0.03) << "ball " << i;
      ++common;
    }
  }
  EXPECT_GE(common, 10);
}

// Each row shows what a camera without rolling shutter shows at the row's own time.
TEST(Renderer, RowsOfARollingShutterAreTakenOneAfterAnother) {
  ThreadPool pool(1);
  World world = empty_world(pool);
  world.quads.push_back({Vector3d(-10, -10, 5), Vector3d::UnitX(), Vector3d::UnitY(), 20, 20,
                         finish_of(world, Pattern::kBrick)});
  const Camera camera = pinhole(160, 121, 150);
  const Motion motion = [](double t) { return Rigid3{exp_so3({0, 0.5 * t, 0.3 * t}), {2 * t, 0, 0}}; };
  RenderOptions options = without_noise();
  Renderer still(world, camera, options, pool);
  options.readout = 0.05;
  const Image<uint8_t> rolling = Renderer(world, camera, options, pool).render(motion, 1, 0);
  for (const int row : {0, 30, 60, 90, 120}) {
    const double time = 1 + options.readout * ((row + 0.5) / 121 - 0.5);
    const auto difference = [&](double at) {
      const Image<uint8_t> image = still.render(motion, at, 0);
      double sum = 0;
      for (int x = 0; x < image.width(); ++x) sum += std::abs(image.row(row)[x] - rolling.row(row)[x]);
      return sum / image.width();
    };
    EXPECT_LT(difference(time), 1.0) << "row " << row;
    EXPECT_GT(difference(time + 0.012), 2.0) << "row " << row;
  }
}

}  // namespace
}  // namespace raysfm::synth
