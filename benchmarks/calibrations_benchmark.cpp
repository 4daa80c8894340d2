// Are the polynomials, axes and poses of a many-camera rig read as they are meant? Points that two of its
// cameras see at one instant lie in one plane with both centres: prints the median angle of SIFT matches to
// that plane, as the file is read and with one convention turned round.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <numbers>
#include <opencv2/features2d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <utility>
#include <vector>

#include "raysfm/camera_files/camera_file.h"
#include "support/shared_data.h"

namespace raysfm {
namespace {

struct Features {
  std::vector<cv::KeyPoint> points;
  cv::Mat descriptors;
};

using Match = std::pair<Eigen::Vector2d, Eigen::Vector2d>;

std::vector<Match> match(const Features& a, const Features& b) {
  std::vector<std::vector<cv::DMatch>> nearest;
  cv::BFMatcher(cv::NORM_L2).knnMatch(a.descriptors, b.descriptors, nearest, 2);
  std::vector<Match> matches;
  for (const auto& pair : nearest) {
    if (pair.size() < 2 || pair[0].distance > 0.7 * pair[1].distance) continue;
    const cv::Point2f p = a.points[pair[0].queryIdx].pt, q = b.points[pair[0].trainIdx].pt;
    matches.push_back({{p.x, p.y}, {q.x, q.y}});
  }
  return matches;
}

// A convention turned round: of the rays of each camera, or of the poses.
struct Reading {
  const char* name;
  std::function<Eigen::Vector3d(const Eigen::Vector3d&)> ray;
  bool inverse_poses;
};

// Median angle between the second ray of a match and the plane of the first ray and the two centres.
double epipolar_angle_deg(const Camera& a, const Camera& b, const std::vector<Match>& matches,
                          const Reading& reading) {
  const Rigid3 rig_from_a = reading.inverse_poses ? a.rig_from_cam.inverse() : a.rig_from_cam;
  const Rigid3 rig_from_b = reading.inverse_poses ? b.rig_from_cam.inverse() : b.rig_from_cam;
  const Eigen::Vector3d baseline = rig_from_b.translation - rig_from_a.translation;
  std::vector<double> angles;
  for (const auto& [p, q] : matches) {
    Ray x, y;
    if (!a.ray(p, &x) || !b.ray(q, &y)) continue;
    const Eigen::Vector3d normal =
        baseline.cross(rig_from_a.rotation * reading.ray(x.direction)).normalized();
    const double sine = normal.dot(rig_from_b.rotation * reading.ray(y.direction));
    angles.push_back(std::asin(std::min(1.0, std::abs(sine))) * 180 / std::numbers::pi);
  }
  if (angles.empty()) return std::nan("");
  std::nth_element(angles.begin(), angles.begin() + angles.size() / 2, angles.end());
  return angles[angles.size() / 2];
}

int run() {
  const std::filesystem::path folder = testing_support::shared_data("rigs/omnimvs-4-fisheye");
  const Result<Rig> rig = read_camera_file(folder / "config.yaml");
  if (!rig) {
    std::printf("%s\n", rig.error().message.c_str());
    return 0;
  }
  const auto sift = cv::SIFT::create(6000);
  std::vector<Features> features(rig->cameras.size());
  for (size_t i = 0; i < features.size(); ++i) {
    const cv::Mat image =
        cv::imread((folder / rig->cameras[i].name / "00001.png").string(), cv::IMREAD_GRAYSCALE);
    sift->detectAndCompute(image, cv::noArray(), features[i].points, features[i].descriptors);
  }
  const auto same = [](const Eigen::Vector3d& v) { return v; };
  const Reading readings[] = {
      {"as read", same, false},
      {"poses inverted", same, true},
      {"x flipped", [](const Eigen::Vector3d& v) { return Eigen::Vector3d(-v.x(), v.y(), v.z()); }, false},
      {"y flipped", [](const Eigen::Vector3d& v) { return Eigen::Vector3d(v.x(), -v.y(), v.z()); }, false},
      {"x, y swapped", [](const Eigen::Vector3d& v) { return Eigen::Vector3d(v.y(), v.x(), v.z()); }, false}};
  for (size_t i = 0; i < features.size(); ++i) {
    for (size_t j = i + 1; j < features.size(); ++j) {
      const std::vector<Match> matches = match(features[i], features[j]);
      std::printf("%s - %s: %zu matches", rig->cameras[i].name.c_str(), rig->cameras[j].name.c_str(),
                  matches.size());
      for (const Reading& reading : readings) {
        std::printf(", %s %.2f deg", reading.name,
                    epipolar_angle_deg(rig->cameras[i], rig->cameras[j], matches, reading));
      }
      std::printf("\n");
    }
  }
  return 0;
}

}  // namespace
}  // namespace raysfm

int main() {
  return raysfm::run();
}
