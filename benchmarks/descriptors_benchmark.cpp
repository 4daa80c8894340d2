// Descriptors beside OpenCV's ORB at the same corners: matches of real pictures taken from different places,
// and how many of them agree with the true motion of the camera.
#include <Eigen/Geometry>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <opencv2/features2d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "raysfm/core/timer.h"
#include "raysfm/features/descriptor.h"
#include "raysfm/features/harris.h"
#include "support/shared_data.h"

namespace raysfm {
namespace {

using testing_support::shared_data;

struct Sequence {
  const char* folder;
  const char* image;
  double fx, fy, cx, cy;
  std::vector<std::pair<int, int>> pairs;
  bool turned = false;  // the second picture, upside down
};

struct TruePose {
  Eigen::Quaterniond world_from_cam;
  Eigen::Vector3d position;
};

std::vector<TruePose> read_truth(const std::string& folder) {
  std::vector<TruePose> poses;
  std::ifstream file(shared_data(folder) / "truth.txt");
  for (std::string line; std::getline(file, line);) {
    std::istringstream stream(line);
    double time = 0;
    TruePose p;
    Eigen::Vector3d& t = p.position;
    Eigen::Quaterniond& q = p.world_from_cam;
    if (stream >> time >> t.x() >> t.y() >> t.z() >> q.x() >> q.y() >> q.z() >> q.w()) poses.push_back(p);
  }
  return poses;
}

// A picture with its corners, described in both ways; their rays are in the frame of the camera.
struct Described {
  std::vector<Eigen::Vector3d> rays, orb_rays;
  DescriptorSet ours;
  std::vector<Descriptor> orb;
  double our_ms = 0, orb_ms = 0;
  int corners = 0;
};

// ORB takes the angle of a point as given: its detector takes that of the centroid of the disc of radius 15.
float centroid_angle(const cv::Mat& image, int x, int y) {
  double mx = 0, my = 0;
  for (int dy = -15; dy <= 15; ++dy) {
    for (int dx = -15; dx <= 15; ++dx) {
      const cv::Point p(x + dx, y + dy);
      if (dx * dx + dy * dy > 15 * 15 || !cv::Rect({}, image.size()).contains(p)) continue;
      mx += dx * image.at<uint8_t>(p), my += dy * image.at<uint8_t>(p);
    }
  }
  return cv::fastAtan2(static_cast<float>(my), static_cast<float>(mx));
}

Described describe(const cv::Mat& image, const Sequence& s, bool upside_down) {
  cv::Mat turned = image;
  if (upside_down) cv::rotate(image, turned, cv::ROTATE_180);
  GrayImage grey(turned.cols, turned.rows);
  for (int y = 0; y < turned.rows; ++y) std::copy_n(turned.ptr(y), turned.cols, grey.row(y));
  const Octaves octaves(std::move(grey), 5 << 19);
  Features corners;
  HarrisDetector().detect(octaves.at(octaves.first()), {.octave = octaves.first()}, &corners);

  Described out;
  out.corners = corners.size();
  const auto ray = [&](double u, double v) -> Eigen::Vector3d {
    if (upside_down) u = turned.cols - 1 - u, v = turned.rows - 1 - v;
    return {(u - s.cx) / s.fx, (v - s.cy) / s.fy, 1};
  };
  Describer describer;
  describer.describe(octaves, corners.pixels, corners.octaves, &out.ours);
  Clock::time_point begin = Clock::now();
  describer.describe(octaves, corners.pixels, corners.octaves, &out.ours);
  out.our_ms = milliseconds_since(begin);
  for (const int i : out.ours.corners) out.rays.push_back(ray(corners.pixels[i].x(), corners.pixels[i].y()));

  std::vector<cv::KeyPoint> points;
  for (const Eigen::Vector2f& p : corners.pixels) {
    points.emplace_back(p.x(), p.y(), 31.0f, centroid_angle(turned, cvRound(p.x()), cvRound(p.y())), 1.0f, 0);
  }
  cv::Mat rows;
  begin = Clock::now();
  cv::ORB::create(5000, 1.2f, 1)->compute(turned, points, rows);
  out.orb_ms = milliseconds_since(begin);
  for (int i = 0; i < rows.rows; ++i) {
    std::memcpy(out.orb.emplace_back().bits.data(), rows.ptr(i), 32);
    out.orb_rays.push_back(ray(points[i].pt.x, points[i].pt.y));
  }
  return out;
}

struct Count {
  int matches = 0, right = 0;
};

// A match is right within 3 pixels of its epipolar line (Sampson), before the camera.
Count count(const std::vector<Descriptor>& a, const std::vector<Eigen::Vector3d>& rays_a,
            const std::vector<Descriptor>& b, const std::vector<Eigen::Vector3d>& rays_b,
            const TruePose& pose_a, const TruePose& pose_b, double focal, float ratio) {
  const Eigen::Matrix3d r = (pose_b.world_from_cam.conjugate() * pose_a.world_from_cam).toRotationMatrix();
  const Eigen::Vector3d t = pose_b.world_from_cam.conjugate() * (pose_a.position - pose_b.position);
  Eigen::Matrix3d e;
  for (int c = 0; c < 3; ++c) e.col(c) = t.cross(r.col(c));
  std::vector<DescriptorMatch> matches;
  match_descriptors(a, b, ratio, &matches);
  Count out;
  for (const DescriptorMatch& m : matches) {
    const Eigen::Vector3d &x = rays_a[m.query], &y = rays_b[m.train];
    const Eigen::Vector3d l = e * x, k = e.transpose() * y;
    const double error =
        focal * std::abs(y.dot(l)) / std::sqrt(l.head<2>().squaredNorm() + k.head<2>().squaredNorm());
    ++out.matches;
    out.right += error < 3;
  }
  return out;
}

void run(const Sequence& s) {
  const std::vector<TruePose> truth = read_truth(s.folder);
  Count ours[2], orb[2];
  double our_us = 0, orb_us = 0, match_ms = 0;
  for (const auto& [i, j] : s.pairs) {
    char name[64];
    const auto read = [&](int k) {
      std::snprintf(name, sizeof name, s.image, k);
      return cv::imread((shared_data(s.folder) / name).string(), cv::IMREAD_GRAYSCALE);
    };
    const Described a = describe(read(i), s, false), b = describe(read(j), s, s.turned);
    for (const int strict : {0, 1}) {
      const float ratio = strict ? 0.8f : 1.0f;
      const Clock::time_point begin = Clock::now();
      const Count o =
          count(a.ours.descriptors, a.rays, b.ours.descriptors, b.rays, truth[i], truth[j], s.fx, ratio);
      match_ms += milliseconds_since(begin) / 2;
      const Count t = count(a.orb, a.orb_rays, b.orb, b.orb_rays, truth[i], truth[j], s.fx, ratio);
      ours[strict].matches += o.matches, ours[strict].right += o.right;
      orb[strict].matches += t.matches, orb[strict].right += t.right;
    }
    our_us += 1e3 * b.our_ms / b.corners;
    orb_us += 1e3 * b.orb_ms / b.corners;
  }
  const double n = static_cast<double>(s.pairs.size());
  std::printf("%-20s%s\n", s.folder, s.turned ? ", the second upside down" : "");
  const auto print = [&](const char* name, const Count* counts, double us) {
    for (const int strict : {0, 1}) {
      const Count& c = counts[strict];
      std::printf("  %-5s %-13s %5.0f right of %5.0f (%2.0f %%)", name, strict ? "ratio 0.8" : "mutual best",
                  c.right / n, c.matches / n, 100.0 * c.right / c.matches);
    }
    std::printf("  %.2f us a corner\n", us / n);
  };
  print("ours", ours, our_us);
  print("ORB", orb, orb_us);
  std::printf("  all with all: %.2f ms\n", match_ms / n);
}

}  // namespace
}  // namespace raysfm

int main() {
  using raysfm::Sequence;
  Sequence herzjesu{"herzjesu-p8", "images/%04d.jpg", 1379.74, 1382.08, 760.095, 503.155, {}};
  for (int i = 0; i < 7; ++i) herzjesu.pairs.push_back({i, i + 1});
  Sequence fountain = herzjesu;
  fountain.folder = "fountain-p11";
  for (int i = 7; i < 10; ++i) fountain.pairs.push_back({i, i + 1});
  Sequence kitchen{"redkitchen-handheld", "images/%06d.jpg", 526.24, 526.24, 319.5, 239.5, {}};
  for (int i = 0; i < 400; i += 37) {
    for (const int gap : {30, 60, 100})
      if (i + gap < 420) kitchen.pairs.push_back({i, i + gap});
  }
  for (Sequence s : {herzjesu, fountain, kitchen}) {
    raysfm::run(s);
    s.turned = true;
    raysfm::run(s);
  }
}
