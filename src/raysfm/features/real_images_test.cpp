// The front end on real frames, judged by the true motion of the camera.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cstdio>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "raysfm/features/coarse_rotation.h"
#include "raysfm/features/feature_grid.h"
#include "raysfm/features/harris.h"
#include "raysfm/features/patch_alignment.h"
#include "raysfm/features/patches.h"
#include "raysfm/features/zncc_matcher.h"
#include "raysfm/image/pyramid.h"
#include "support/shared_data.h"

namespace raysfm {
namespace {

using testing_support::shared_data;

struct TruePose {
  double time;
  Eigen::Quaterniond world_from_cam;
  Eigen::Vector3d position;
};

std::vector<TruePose> read_truth(const std::string& sequence) {
  std::vector<TruePose> poses;
  std::ifstream file(shared_data(sequence) / "truth.txt");
  for (std::string line; std::getline(file, line);) {
    TruePose p;
    Eigen::Quaterniond& q = p.world_from_cam;
    std::istringstream stream(line);
    if (stream >> p.time >> p.position.x() >> p.position.y() >> p.position.z() >> q.x() >> q.y() >> q.z() >>
        q.w()) {
      q.normalize();
      poses.push_back(p);
    }
  }
  return poses;
}

cv::Mat read_grey(const std::string& path) {
  return cv::imread(shared_data(path).string(), cv::IMREAD_GRAYSCALE);
}

GrayView view(const cv::Mat& m) {
  return {m.data, m.cols, m.rows, static_cast<ptrdiff_t>(m.step)};
}

std::string numbered(const std::string& pattern, int i) {
  char name[256];
  std::snprintf(name, sizeof name, pattern.c_str(), i);
  return name;
}

// Undistorted perspective camera.
struct Lens {
  double f, cx, cy;
  Eigen::Vector3d ray(const Eigen::Vector2f& p) const { return {(p.x() - cx) / f, (p.y() - cy) / f, 1}; }
  Eigen::Vector2d pixel(const Eigen::Vector3d& x) const {
    return {f * x.x() / x.z() + cx, f * x.y() / x.z() + cy};
  }
};

struct Quality {
  int matches = 0, inliers = 0, aligned = 0, aligned_inliers = 0;
};

// Matches of two frames without any prediction; an inlier is within 2 pixels of its epipolar line (Sampson).
Quality match_frames(const cv::Mat& first, const cv::Mat& second, const TruePose& a, const TruePose& b,
                     const Lens& lens, float radius) {
  HarrisDetector detector;
  Features fa, fb;
  detector.detect(view(first), {}, &fa);
  detector.detect(view(second), {}, &fb);
  PatchSet pa, pb;
  extract_patches(view(first), fa.pixels, &pa);
  extract_patches(view(second), fb.pixels, &pb);
  FeatureGrid grid;
  grid.build(fb.pixels, second.cols, second.rows);
  const std::vector<float> radii(fa.pixels.size(), radius);
  std::vector<ZnccMatch> matches;
  ZnccMatcher().match(pa, fa.pixels, radii, pb, fb.pixels, grid, {}, &matches);

  std::vector<Eigen::Vector2f> from, to;
  for (const ZnccMatch& m : matches) {
    from.push_back(fa.pixels[m.query]);
    to.push_back(fb.pixels[m.train]);
  }
  const std::vector<Eigen::Matrix2f> identity(from.size(), Eigen::Matrix2f::Identity());
  std::vector<PatchAlignment> aligned(from.size());
  PatchAligner().align(view(first), from, identity, view(second), to, aligned);

  const Eigen::Matrix3d rotation = (b.world_from_cam.conjugate() * a.world_from_cam).toRotationMatrix();
  const Eigen::Vector3d translation = b.world_from_cam.conjugate() * (a.position - b.position);
  Eigen::Matrix3d essential;
  for (int c = 0; c < 3; ++c) essential.col(c) = translation.cross(rotation.col(c));
  const auto sampson = [&](const Eigen::Vector2f& p, const Eigen::Vector2f& q) {
    const Eigen::Vector3d x = lens.ray(p), y = lens.ray(q);
    const Eigen::Vector3d l = essential * x, k = essential.transpose() * y;
    return lens.f * std::abs(y.dot(l)) / std::sqrt(l.head<2>().squaredNorm() + k.head<2>().squaredNorm());
  };
  Quality quality;
  for (size_t i = 0; i < from.size(); ++i) {
    ++quality.matches;
    quality.inliers += sampson(from[i], to[i]) < 2;
    if (!aligned[i].converged) continue;
    ++quality.aligned;
    quality.aligned_inliers += sampson(from[i], aligned[i].pixel) < 1;
  }
  return quality;
}

TEST(RealImages, FramesOfACarMatch) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("kitti07-mono");
  const auto truth = read_truth("kitti07-mono");
  const Lens lens{707.0912, 601.8873, 183.1104};
  for (int i = 10; i < 90; i += 20) {
    const std::string pattern = "kitti07-mono/image_0/%06d.png";
    const Quality q = match_frames(read_grey(numbered(pattern, i)), read_grey(numbered(pattern, i + 1)),
                                   truth[i], truth[i + 1], lens, 60);
    EXPECT_GT(q.matches, 600) << i;
    EXPECT_GT(q.inliers, 0.75 * q.matches) << i;
    EXPECT_GT(q.aligned, 0.85 * q.matches) << i;
    EXPECT_GT(q.aligned_inliers, 0.8 * q.aligned) << i;
  }
}

TEST(RealImages, FramesOfAHandHeldCameraMatch) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("tsukuba-mono");
  const auto truth = read_truth("tsukuba-mono");
  for (int i = 0; i < 90; i += 20) {
    const std::string pattern = "tsukuba-mono/images/%06d.jpg";
    const Quality q = match_frames(read_grey(numbered(pattern, i)), read_grey(numbered(pattern, i + 2)),
                                   truth[i], truth[i + 2], {615, 320, 240}, 60);
    EXPECT_GT(q.matches, 500) << i;
    EXPECT_GT(q.inliers, 0.75 * q.matches) << i;
    EXPECT_GT(q.aligned, 0.7 * q.matches) << i;
    EXPECT_GT(q.aligned_inliers, 0.8 * q.aligned) << i;
  }
}

// Almost pure rotation, up to 100 pixels from frame to next but one, with motion blur.
TEST(RealImages, CoarseMotionFollowsAFastRotation) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("fr1-rpy");
  const auto truth = read_truth("fr1-rpy");
  const auto orientation = [&](double time) {
    auto after = std::lower_bound(truth.begin(), truth.end(), time,
                                  [](const TruePose& p, double t) { return p.time < t; });
    after = std::clamp(after, truth.begin() + 1, truth.end() - 1);
    const double t = (time - after[-1].time) / (after->time - after[-1].time);
    return after[-1].world_from_cam.slerp(t, after->world_from_cam);
  };
  std::vector<std::pair<double, std::string>> frames;
  std::ifstream list(shared_data("fr1-rpy/rgb.txt"));
  for (std::string line; std::getline(list, line);) {
    std::istringstream stream(line);
    std::pair<double, std::string> frame;
    if (stream >> frame.first >> frame.second) frames.push_back(frame);
  }
  ASSERT_GT(frames.size(), 100u);

  const Lens lens{517, 318.6, 255.3};  // its distortion is left out
  std::vector<double> errors, motions;
  for (size_t i = 0; i + 2 < frames.size(); i += 3) {
    const cv::Mat first = read_grey("fr1-rpy/" + frames[i].second),
                  second = read_grey("fr1-rpy/" + frames[i + 2].second);
    GrayImage a, b;
    const int side = make_thumbnail(view(first), 80, &a);
    make_thumbnail(view(second), 80, &b);
    const CoarseMotion motion = estimate_coarse_motion(a.view(), b.view(), static_cast<float>(side));
    const Eigen::Quaterniond turn =
        orientation(frames[i + 2].first).conjugate() * orientation(frames[i].first);
    for (int y = 120; y < 480; y += 120) {
      for (int x = 160; x < 640; x += 160) {
        const Eigen::Vector2f p(x, y);
        const Eigen::Vector2d moved = lens.pixel(turn * lens.ray(p));
        errors.push_back((motion.apply(p, 640, 480).cast<double>() - moved).norm());
        motions.push_back((p.cast<double>() - moved).norm());
      }
    }
  }
  const auto quantile = [](std::vector<double> v, double q) {
    std::sort(v.begin(), v.end());
    return v[static_cast<size_t>(q * static_cast<double>(v.size() - 1))];
  };
  EXPECT_GT(quantile(motions, 0.9), 50);
  EXPECT_LT(quantile(errors, 0.5), 7);
  EXPECT_LT(quantile(errors, 0.95), 20);
}

}  // namespace
}  // namespace raysfm
