#include "raysfm/synth/renderer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>

#include "raysfm/geometry/rotation.h"
#include "raysfm/synth/sequence.h"
#include "support/test_worlds.h"

namespace raysfm::synth {
namespace {

using Eigen::Vector3d;

cv::Mat gray_mat(const Image<uint8_t>& bgr) {
  const GrayImage gray = to_gray(bgr.view());
  return cv::Mat(gray.height(), gray.width(), CV_8U, const_cast<uint8_t*>(gray.view().data),
                 static_cast<size_t>(gray.view().stride))
      .clone();
}

Image<uint8_t> render_once(const World& world, const Camera& camera, const Rigid3& pose,
                           const RenderOptions& options) {
  ThreadPool pool(1);
  return Renderer(world, camera, options, pool).render(stand_at(pose), 0, 0);
}

// Where the picture of `from` has gone in `to`: OpenCV's tracker of Lucas and Kanade, whose interpolation is
// finer than that of its image warps, averaged over a lattice of windows. Both pictures are smoothed alike,
// since linear interpolation between pixels biases what is sharp.
cv::Point2d displacement(const cv::Mat& from, const cv::Mat& to) {
  cv::Mat a, b;
  cv::GaussianBlur(from, a, {}, 1.0);
  cv::GaussianBlur(to, b, {}, 1.0);
  std::vector<cv::Point2f> points, moved;
  for (int y = 32; y <= from.rows - 32; y += 16) {
    for (int x = 32; x <= from.cols - 32; x += 16) points.emplace_back(x, y);
  }
  std::vector<uchar> status;
  cv::calcOpticalFlowPyrLK(a, b, points, moved, status, cv::noArray(), {41, 41}, 0,
                           cv::TermCriteria(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 100, 1e-5));
  cv::Point2d sum;
  for (size_t i = 0; i < points.size(); ++i) {
    EXPECT_TRUE(status[i]);
    sum += cv::Point2d(moved[i] - points[i]) / static_cast<double>(points.size());
  }
  return sum;
}

// A wall in the plane z = 5, rotated about the vertical through its middle.
World wall(Pattern pattern, double turn, ThreadPool& pool) {
  World world = empty_world(pool);
  const Vector3d right(std::cos(turn), 0, std::sin(turn));
  Finish finish = finish_of(world, pattern);
  world.quads.push_back({Vector3d(0, -10, 5) - 10 * right, right, Vector3d::UnitY(), 20, 20, finish});
  return world;
}

TEST(Renderer, SameImageForAnyNumberOfThreads) {
  ThreadPool none(0), some(3);
  const World world = *make_world("street", {}, some);
  const Motion motion = *make_motion(world.stage, world.habit, {"drive", 10, 10, 0});
  RenderOptions options;
  options.shutter = 0.05;
  options.shutter_samples = 2;
  const Camera camera = pinhole(161, 97, 120);
  const Image<uint8_t> a = Renderer(world, camera, options, none).render(motion, 1.5, 7);
  const Image<uint8_t> b = Renderer(world, camera, options, some).render(motion, 1.5, 7);
  for (int y = 0; y < a.height(); ++y)
    ASSERT_EQ(0, std::memcmp(a.row(y), b.row(y), a.width())) << "row " << y;
  const Image<uint8_t> other = Renderer(world, camera, options, some).render(motion, 1.5, 8);
  EXPECT_NE(0, std::memcmp(a.row(50), other.row(50), a.width())) << "each frame has noise of its own";
}

TEST(Renderer, NoiseIsAsAskedFor) {
  ThreadPool pool(1);
  World world = empty_world(pool);
  Finish flat = finish_of(world, Pattern::kPlain);
  flat.stains = flat.grain = 0;
  flat.tint = Colour::Constant(0.7f);
  world.quads.push_back({{-10, -10, 5}, Vector3d::UnitX(), Vector3d::UnitY(), 20, 20, flat});
  RenderOptions options;
  options.noise = 4;
  cv::Scalar mean, deviation;
  cv::meanStdDev(gray_mat(render_once(world, pinhole(200, 200, 200), {}, options)), mean, deviation);
  EXPECT_NEAR(deviation[0], 4, 0.1);
}

// Two views whose images differ by a known shift everywhere: a camera that slides along a wall.
TEST(Renderer, ShiftsBetweenImagesAreThoseOfTheGeometry) {
  ThreadPool pool(1);
  const double f = 400, depth = 5;
  RenderOptions options;
  options.noise = 0;
  for (const Pattern pattern : {Pattern::kBrick, Pattern::kPlaster}) {
    const World world = wall(pattern, 0, pool);
    const Camera camera = pinhole(256, 256, f);
    const cv::Mat first = gray_mat(render_once(world, camera, {}, options));
    for (const double shift : {0.1, 0.25, 0.5, 0.7, 0.9}) {
      const Rigid3 moved{Eigen::Quaterniond::Identity(), {shift * depth / f, -0.5 * shift * depth / f, 0}};
      const cv::Point2d measured = displacement(first, gray_mat(render_once(world, camera, moved, options)));
      EXPECT_NEAR(measured.x, -shift, 0.02) << "pattern " << static_cast<int>(pattern);
      EXPECT_NEAR(measured.y, 0.5 * shift, 0.02) << "pattern " << static_cast<int>(pattern);
    }
  }
}

// A wall seen at a slant from two places: the second image, brought onto the first by the homography of the
// plane, lies on it to a few hundredths of a pixel.
TEST(Renderer, SlantedPlaneObeysItsHomography) {
  ThreadPool pool(1);
  const double turn = 0.8;
  const World world = wall(Pattern::kBrick, turn, pool);
  const Camera camera = pinhole(384, 384, 350);
  RenderOptions options;
  options.noise = 0;
  const Rigid3 world_from_second{exp_so3({0.02, -0.05, 0.03}), {0.31, 0.08, 0.22}};
  const cv::Mat first = gray_mat(render_once(world, camera, {}, options));
  const cv::Mat second = gray_mat(render_once(world, camera, world_from_second, options));

  const Vector3d normal(-std::sin(turn), 0, std::cos(turn));  // normal . x = offset on the wall
  const double offset = normal.z() * 5;
  Eigen::Matrix3d k;
  k << 350, 0, 191.5, 0, 350, 191.5, 0, 0, 1;
  const Rigid3 second_from_world = world_from_second.inverse();
  const Eigen::Matrix3d h = k *
                            (second_from_world.rotation.toRotationMatrix() +
                             second_from_world.translation * normal.transpose() / offset) *
                            k.inverse();
  cv::Mat pulled, map(3, 3, CV_64F);
  for (int i = 0; i < 9; ++i) map.at<double>(i / 3, i % 3) = h(i / 3, i % 3);
  cv::warpPerspective(second, pulled, map, second.size(), cv::INTER_CUBIC | cv::WARP_INVERSE_MAP);

  int patches = 0;
  for (int y = 60; y <= 228; y += 56) {
    for (int x = 60; x <= 228; x += 56) {
      const cv::Rect patch(x, y, 96, 96);
      const cv::Point2d off = displacement(first(patch), pulled(patch));
      EXPECT_LT(std::hypot(off.x, off.y), 0.03) << "patch at " << x << ", " << y;
      ++patches;
    }
  }
  EXPECT_EQ(patches, 16);
}

// Corners of the two checkerboards, found by OpenCV, against their exact projections. Returns the largest
// error.
double checkerboard_error(const Camera& camera, int* found) {
  ThreadPool pool(1);
  const World world = *make_world("board", {}, pool);
  const Motion motion = *make_motion(world.stage, world.habit, {"orbit", 6, 1, 0});
  RenderOptions options;
  options.noise = 1;
  Renderer renderer(world, camera, options, pool);
  double worst = 0;
  *found = 0;
  for (const double time : {1.0, 2.5, 4.0, 5.5}) {
    const cv::Mat image = gray_mat(renderer.render(motion, time, static_cast<int>(10 * time)));
    const Rigid3 cam_from_world = motion(time).inverse();
    for (int board = 0; board < 2; ++board) {
      std::vector<Eigen::Vector2d> truth;
      double left = 1e9, right = -1e9;
      for (int i = 48 * board; i < 48 * (board + 1); ++i) {
        Eigen::Vector2d pixel;
        EXPECT_TRUE(camera.project(cam_from_world * world.landmarks[static_cast<size_t>(i)], &pixel));
        truth.push_back(pixel);
        left = std::min(left, pixel.x());
        right = std::max(right, pixel.x());
      }
      // The other board is painted over, so that the search finds this one.
      cv::Mat alone = image.clone();
      const int border = static_cast<int>(board == 0 ? right + 25 : left - 25);
      const cv::Rect rest = board == 0 ? cv::Rect(border, 0, image.cols - border, image.rows)
                                       : cv::Rect(0, 0, border, image.rows);
      alone(rest & cv::Rect(0, 0, image.cols, image.rows)).setTo(200);
      std::vector<cv::Point2f> corners;
      if (!cv::findChessboardCorners(alone, cv::Size(8, 6), corners)) continue;
      cv::cornerSubPix(image, corners, cv::Size(4, 4), cv::Size(-1, -1),
                       cv::TermCriteria(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 60, 1e-4));
      for (const Eigen::Vector2d& t : truth) {
        double nearest = 1e9;
        for (const cv::Point2f& c : corners)
          nearest = std::min(nearest, std::hypot(c.x - t.x(), c.y - t.y()));
        worst = std::max(worst, nearest);
      }
      ++*found;
    }
  }
  return worst;
}

TEST(Renderer, CheckerboardCornersStandWhereTheyProject) {
  int found = 0;
  EXPECT_LT(checkerboard_error(pinhole(640, 480, 520), &found), 0.1);
  EXPECT_GE(found, 6);
}

TEST(Renderer, DistortedCameraRendersWhatItProjects) {
  Camera camera = pinhole(640, 480, 520);
  camera.model = Radtan{500, 505, 322.3, 236.8, -0.28, 0.09, 0.0012, -0.0008};
  int found = 0;
  EXPECT_LT(checkerboard_error(camera, &found), 0.1);
  EXPECT_GE(found, 6);
}

TEST(Renderer, PeopleMoveAndWallsDoNot) {
  ThreadPool pool(1);
  World world = wall(Pattern::kBrick, 0, pool);
  Walker walker;
  walker.from = {-2, 1, 4};
  walker.to = {2, 1, 4};
  walker.skin = walker.coat = walker.trousers = finish_of(world, Pattern::kCloth);
  world.walkers.push_back(walker);
  RenderOptions options;
  options.noise = 0;
  Renderer renderer(world, pinhole(200, 200, 120), options, pool);
  const cv::Mat a = gray_mat(renderer.render(stand_at({}), 0.5, 0)),
                b = gray_mat(renderer.render(stand_at({}), 1.2, 0));
  cv::Mat difference;
  cv::absdiff(a, b, difference);
  const auto changed = [&](double time) {
    const Vector3d middle = walker.place(time) - Vector3d(0, 0.6 * walker.height, 0);
    const cv::Point at(static_cast<int>(99.5 + 120 * middle.x() / 4),
                       static_cast<int>(99.5 + 120 * middle.y() / 4));
    return cv::mean(difference(cv::Rect(at.x - 2, at.y - 2, 5, 5)))[0];
  };
  EXPECT_GT(changed(0.5), 5) << "where the walker was";
  EXPECT_GT(changed(1.2), 5) << "where the walker went";
  EXPECT_EQ(cv::mean(difference(cv::Rect(150, 20, 40, 40)))[0], 0) << "the wall far from the walker";
}

TEST(Renderer, BlurSmearsAlongTheMotionOnly) {
  ThreadPool pool(1);
  const World world = wall(Pattern::kBrick, 0, pool);
  RenderOptions sharp, blurred;
  sharp.noise = blurred.noise = 0;
  blurred.shutter = 0.1;
  const Motion slide = [](double t) { return Rigid3{Eigen::Quaterniond::Identity(), {t, 0, 0}}; };
  const auto roughness = [&](const RenderOptions& options, bool across) {
    const cv::Mat image =
        gray_mat(Renderer(world, pinhole(160, 160, 300), options, pool).render(slide, 0, 0));
    cv::Mat gradient;
    cv::Sobel(image, gradient, CV_32F, across ? 1 : 0, across ? 0 : 1);
    return cv::mean(cv::abs(gradient))[0];
  };
  EXPECT_LT(roughness(blurred, true), 0.6 * roughness(sharp, true));
  EXPECT_GT(roughness(blurred, false), 0.75 * roughness(sharp, false));
}

TEST(Renderer, CamerasOfARigSeeFromTheirOwnPlaces) {
  ThreadPool pool(1);
  const World world = wall(Pattern::kPlaster, 0, pool);
  RenderOptions options;
  options.noise = 0;
  Camera camera = pinhole(128, 128, 200);
  const Rigid3 pose{exp_so3({0.03, 0.1, 0}), {0.2, 0, 0.4}};
  camera.rig_from_cam = {exp_so3({0, -0.2, 0.05}), {0.3, 0.1, -0.2}};
  const cv::Mat in_rig = gray_mat(render_once(world, camera, pose, options));
  const Rigid3 world_from_cam = pose * camera.rig_from_cam;
  camera.rig_from_cam = {};
  const cv::Mat alone = gray_mat(render_once(world, camera, world_from_cam, options));
  cv::Mat difference;
  cv::absdiff(in_rig, alone, difference);
  EXPECT_LT(cv::mean(difference)[0], 0.2);
}

TEST(Sequence, BadOptionsAreRefusedInOneLine) {
  ThreadPool pool(0);
  const Rig rig{{default_camera()}};
  const auto message = [&](const SequenceOptions& o) {
    const auto sequence = Sequence::create(o, rig, pool);
    return sequence.ok() ? std::string() : sequence.error().message;
  };
  SequenceOptions o;
  o.world = "moon";
  EXPECT_NE(message(o).find("street"), std::string::npos);
  o.world = "board";
  o.motion = "fly";
  EXPECT_NE(message(o).find("fly"), std::string::npos);
  o.motion = "";
  o.length = 50;
  EXPECT_NE(message(o).find("50"), std::string::npos);
  o.length = 0;
  o.fps = std::nan("");
  EXPECT_NE(message(o), "");
  o.fps = 0;
  o.zoom = 0;
  EXPECT_NE(message(o).find("zoom: 0"), std::string::npos);
  o.zoom = 1;
  o.render.samples = 5;
  EXPECT_NE(message(o).find("samples: 5"), std::string::npos);
  o = {};
  o.world = "board";
  Camera huge = default_camera();
  huge.width = huge.height = 30000;
  EXPECT_FALSE(Sequence::create(o, Rig{{huge}}, pool));
  EXPECT_FALSE(Sequence::create(o, Rig{}, pool));
}

TEST(Sequence, ZoomMagnifiesAboutThePrincipalPoint) {
  ThreadPool pool(1);
  SequenceOptions o;
  o.world = "board";
  o.motion = "rotate";
  o.frames = 11;
  o.fps = 1e4;  // hardly any motion
  o.zoom = 1.5;
  o.render.noise = 0;
  const auto zooming = Sequence::create(o, {{pinhole(200, 150, 150)}}, pool);
  o.zoom = 1;
  const auto fixed = Sequence::create(o, {{pinhole(200, 150, 225)}}, pool);
  ASSERT_TRUE(zooming && fixed);
  EXPECT_NEAR(lens_of((*zooming)->camera(0, 0))->fx, 150, 1e-9);
  EXPECT_NEAR(lens_of((*zooming)->camera(10, 0))->fx, 225, 1e-9);
  cv::Mat difference;
  cv::absdiff(gray_mat((*zooming)->render(10, 0)), gray_mat((*fixed)->render(10, 0)), difference);
  EXPECT_EQ(cv::countNonZero(difference), 0);
}

TEST(Sequence, ShortDriveKeepsTheUsualSpeed) {
  ThreadPool pool(1);
  SequenceOptions o;
  o.world = "street";
  o.frames = 45;
  const auto sequence = Sequence::create(o, {{pinhole(64, 48, 50)}}, pool);
  ASSERT_TRUE(sequence);
  EXPECT_EQ((*sequence)->frames(), 45);
  EXPECT_DOUBLE_EQ((*sequence)->timestamp(15), 2.0);
  EXPECT_NEAR((*sequence)->world_from_rig(44).translation.z(), 44 * 70.0 / 445, 0.1);
  EXPECT_EQ((*sequence)->render(3, 0).width(), 3 * 64);
}

}  // namespace
}  // namespace raysfm::synth
