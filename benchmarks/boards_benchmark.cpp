// Real chessboards seen by real cameras. OpenCV finds the corners and calibrates; the project then finds the
// pose of each board from the rays of the same camera, and of a ray table fitted to it. Prints the
// reprojection error of both, and how constant the transform between the two cameras of a rig is over the
// pairs.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <map>
#include <numbers>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "raysfm/camera/fit_model.h"
#include "raysfm/camera/pixel_finder.h"
#include "raysfm/robust/absolute_pose.h"
#include "support/shared_data.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;

struct Board {
  cv::Size size;  // inner corners
  double square;  // its length unit decides that of the poses
};

// The corners of the views of one camera, by the number in the name of the image.
struct Views {
  cv::Size image;
  std::map<int, std::vector<cv::Point2f>> corners;
};

int number_in(const std::string& name) {
  const size_t end = name.find_last_of("0123456789");
  size_t begin = end;
  while (begin > 0 && std::isdigit(static_cast<unsigned char>(name[begin - 1]))) --begin;
  return end == std::string::npos ? -1 : std::stoi(name.substr(begin, end - begin + 1));
}

Views find_corners(const fs::path& folder, const std::string& prefix, const Board& board) {
  Views views;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().stem().string();
    if (!name.starts_with(prefix)) continue;
    const cv::Mat image = cv::imread(entry.path().string(), cv::IMREAD_GRAYSCALE);
    std::vector<cv::Point2f> corners;
    if (!cv::findChessboardCorners(image, board.size, corners)) continue;
    cv::cornerSubPix(image, corners, {3, 3}, {-1, -1},
                     cv::TermCriteria(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 100, 1e-4));
    views.image = image.size();
    views.corners[number_in(name)] = corners;
  }
  return views;
}

std::vector<cv::Point3f> board_points(const Board& board) {
  std::vector<cv::Point3f> points;
  for (int i = 0; i < board.size.height; ++i) {
    for (int j = 0; j < board.size.width; ++j) {
      points.emplace_back(static_cast<float>(j * board.square), static_cast<float>(i * board.square), 0.f);
    }
  }
  return points;
}

struct OpenCvResult {
  Camera camera;
  double rms = std::numeric_limits<double>::infinity();
  std::map<int, Rigid3> cam_from_board;
};

Rigid3 pose_of(const cv::Mat& rvec, const cv::Mat& tvec) {
  cv::Mat r;
  cv::Rodrigues(rvec, r);
  Eigen::Matrix3d rotation;
  for (int i = 0; i < 9; ++i) rotation(i / 3, i % 3) = r.at<double>(i / 3, i % 3);
  return {Eigen::Quaterniond(rotation), Eigen::Map<const Eigen::Vector3d>(tvec.ptr<double>())};
}

// From one guess of the focal length; 0: OpenCV's own.
double calibrate_fisheye(const std::vector<std::vector<cv::Point3f>>& points,
                         const std::vector<std::vector<cv::Point2f>>& corners, cv::Size image, double guess,
                         cv::Mat* k, cv::Mat* d, std::vector<cv::Mat>* rvecs, std::vector<cv::Mat>* tvecs) {
  int flags = cv::fisheye::CALIB_RECOMPUTE_EXTRINSIC | cv::fisheye::CALIB_FIX_SKEW;
  if (guess > 0) {
    flags |= cv::fisheye::CALIB_USE_INTRINSIC_GUESS;
    *k = (cv::Mat_<double>(3, 3) << guess, 0, 0.5 * image.width, 0, guess, 0.5 * image.height, 0, 0, 1);
    *d = cv::Mat::zeros(4, 1, CV_64F);
  }
  try {
    return cv::fisheye::calibrate(
        points, corners, image, *k, *d, *rvecs, *tvecs, flags,
        cv::TermCriteria(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 200, 1e-9));
  } catch (const cv::Exception&) {
    return std::numeric_limits<double>::infinity();  // it gives up where a step leads nowhere
  }
}

OpenCvResult calibrate(const Views& views, const Board& board, bool fisheye) {
  const std::vector<std::vector<cv::Point3f>> points(views.corners.size(), board_points(board));
  std::vector<std::vector<cv::Point2f>> corners;
  for (const auto& [number, view] : views.corners) corners.push_back(view);
  cv::Mat k, d;
  std::vector<cv::Mat> rvecs, tvecs;
  OpenCvResult result;
  if (fisheye) {
    for (const double guess : {0.0, 0.2, 0.25, 0.3, 0.35, 0.4}) {
      cv::Mat new_k, new_d;
      std::vector<cv::Mat> new_rvecs, new_tvecs;
      const double rms = calibrate_fisheye(points, corners, views.image, guess * views.image.width, &new_k,
                                           &new_d, &new_rvecs, &new_tvecs);
      if (!(rms < result.rms)) continue;
      result.rms = rms;
      k = new_k;
      d = new_d;
      rvecs = new_rvecs;
      tvecs = new_tvecs;
    }
  } else {
    result.rms = cv::calibrateCamera(points, corners, views.image, k, d, rvecs, tvecs);
  }
  const double fx = k.at<double>(0, 0), fy = k.at<double>(1, 1), cx = k.at<double>(0, 2),
               cy = k.at<double>(1, 2);
  const double* c = d.ptr<double>();
  if (fisheye) result.camera.model = KannalaBrandt{fx, fy, cx, cy, c[0], c[1], c[2], c[3]};
  if (!fisheye) result.camera.model = Radtan{fx, fy, cx, cy, c[0], c[1], c[2], c[3], c[4]};
  result.camera.name = "board";
  result.camera.width = views.image.width;
  result.camera.height = views.image.height;
  size_t i = 0;
  for (const auto& [number, view] : views.corners) {
    result.cam_from_board[number] = pose_of(rvecs[i].reshape(1, 3), tvecs[i].reshape(1, 3));
    ++i;
  }
  return result;
}

// Poses of the boards, camera from board, by the number of the view; from the rays alone.
struct Poses {
  std::map<int, Rigid3> cam_from_board;
  double rms = 0;  // pixels, all corners of the posed boards, by where the camera sees them
  int corners = 0, outliers = 0;
};

Poses find_poses(const Camera& camera, const Views& views, const Board& board) {
  Poses poses;
  PoseEstimator estimator;
  const PixelFinder finder(camera);
  const std::vector<cv::Point3f> points = board_points(board);
  double sum = 0;
  for (const auto& [number, corners] : views.corners) {
    std::vector<Eigen::Vector3d> world;
    std::vector<ObservedRay> rays;
    std::vector<Eigen::Vector2d> pixels;
    for (size_t i = 0; i < corners.size(); ++i) {
      ObservedRay ray;
      const Eigen::Vector2d pixel(corners[i].x, corners[i].y);
      if (!observe_ray(camera, pixel, AngularWeight::kPixel, &ray)) continue;
      world.emplace_back(points[i].x, points[i].y, points[i].z);
      rays.push_back(ray);
      pixels.push_back(pixel);
    }
    PoseObservations observations;
    observations.points_in_world = world;
    observations.rays = rays;
    PoseOptions options;
    options.loss = {};  // the corners are OpenCV's, and it weighs them alike
    PoseEstimate estimate;
    estimator.estimate(Rig{{camera}}, observations, nullptr, options, &estimate);
    if (!estimate.ok()) continue;
    poses.cam_from_board[number] = estimate.rig_from_world;
    for (size_t i = 0; i < world.size(); ++i) {
      Eigen::Vector2d seen;
      if (!finder.find(estimate.rig_from_world * world[i], &seen)) continue;
      sum += (seen - pixels[i]).squaredNorm();
      ++poses.corners;
      poses.outliers += estimate.inlier[i] == 0;
    }
  }
  poses.rms = std::sqrt(sum / std::max(1, poses.corners));
  return poses;
}

std::string intrinsics(const CameraModel& model) {
  return std::visit(
      []<typename Model>(const Model& m) -> std::string {
        if constexpr (requires { m.fx; }) {
          char text[100];
          std::snprintf(text, sizeof text, "f %.2f/%.2f c %.2f/%.2f", m.fx, m.fy, m.cx, m.cy);
          return text;
        } else {
          return "";
        }
      },
      model);
}

// Camera from board, by number of the view.
struct PosesOfBoth {
  std::map<int, Rigid3> ours, opencv;
};

// One camera: OpenCV's calibration, and poses through it in the models that can stand for it.
PosesOfBoth run_camera(const std::string& name, const Views& views, const Board& board, bool fisheye) {
  const OpenCvResult opencv = calibrate(views, board, fisheye);
  std::printf("%s: %zu boards, OpenCV %s, rms %.4f px\n", name.c_str(), views.corners.size(),
              intrinsics(opencv.camera.model).c_str(), opencv.rms);
  PosesOfBoth both;
  both.opencv = opencv.cam_from_board;
  for (const char* model : {"", "ray-table"}) {
    Camera camera = opencv.camera;
    double difference = 0;
    if (*model) {
      const Result<RayFit> fit = fit_model(camera, model);
      if (!fit) continue;
      camera = fit->camera;
      difference = fit->max_px;
    }
    const Poses poses = find_poses(camera, views, board);
    std::printf("  %-14s rms %.4f px, %+.1f %% of OpenCV's; %zu of %zu boards posed, %d corners, %d outliers",
                std::string(model_name(camera.model)).c_str(), poses.rms, 100 * (poses.rms / opencv.rms - 1),
                poses.cam_from_board.size(), views.corners.size(), poses.corners, poses.outliers);
    if (*model) std::printf("; differs from the calibration by up to %.3f px", difference);
    std::printf("\n");
    if (!*model) both.ours = poses.cam_from_board;
  }
  return both;
}

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

// How far the second camera's place in the first scatters over the pairs.
void print_scatter(const char* whose, const std::map<int, Rigid3>& first, const std::map<int, Rigid3>& second,
                   const char* unit) {
  std::vector<Rigid3> transforms;
  for (const auto& [number, first_from_board] : first) {
    const auto other = second.find(number);
    if (other != second.end()) transforms.push_back(first_from_board * other->second.inverse());
  }
  if (transforms.size() < 2) return;
  Eigen::Vector3d middle;
  for (int c = 0; c < 3; ++c) {
    std::vector<double> values;
    for (const Rigid3& t : transforms) values.push_back(t.translation(c));
    middle(c) = median(values);
  }
  Eigen::Vector4d sum = Eigen::Vector4d::Zero();
  for (const Rigid3& t : transforms) {
    const Eigen::Vector4d q = t.rotation.coeffs();
    sum += q.dot(transforms.front().rotation.coeffs()) < 0 ? Eigen::Vector4d(-q) : q;
  }
  const Eigen::Quaterniond mean(Eigen::Quaterniond(sum).normalized());
  std::vector<double> shifts, angles;
  for (const Rigid3& t : transforms) {
    shifts.push_back((t.translation - middle).norm());
    angles.push_back(t.rotation.angularDistance(mean) * 180 / std::numbers::pi);
  }
  std::printf(
      "  rig by %s: %zu pairs, second camera at (%.2f, %.2f, %.2f) %s in the first; scatter %.2f %s "
      "(median; largest %.2f), %.3f deg (largest %.3f)\n",
      whose, transforms.size(), middle.x(), middle.y(), middle.z(), unit, median(shifts), unit,
      *std::max_element(shifts.begin(), shifts.end()), median(angles),
      *std::max_element(angles.begin(), angles.end()));
}

void print_rig(const PosesOfBoth& first, const PosesOfBoth& second, const char* unit) {
  print_scatter("poses from rays", first.ours, second.ours, unit);
  print_scatter("OpenCV's poses", first.opencv, second.opencv, unit);
}

void run() {
  const fs::path boards = testing_support::shared_data("boards");
  const Board stereo{{9, 6}, 24.23}, unit{{9, 6}, 1}, fish{{8, 6}, 1};
  {
    const Views left = find_corners(boards / "fisheye-stereo", "left", stereo);
    const Views right = find_corners(boards / "fisheye-stereo", "right", stereo);
    const PosesOfBoth a = run_camera("fisheye-stereo left", left, stereo, true);
    const PosesOfBoth b = run_camera("fisheye-stereo right", right, stereo, true);
    print_rig(a, b, "mm");
  }
  run_camera("fisheye-vehicle", find_corners(boards / "fisheye-vehicle", "img", unit), unit, true);
  run_camera("ocam-fish1", find_corners(boards / "ocam-fish1", "Fisheye1_", fish), fish, true);
  {
    const Views left = find_corners(boards / "pinhole-stereo", "left", unit);
    const Views right = find_corners(boards / "pinhole-stereo", "right", unit);
    const PosesOfBoth a = run_camera("pinhole-stereo left", left, unit, false);
    const PosesOfBoth b = run_camera("pinhole-stereo right", right, unit, false);
    print_rig(a, b, "squares");
  }
}

}  // namespace
}  // namespace raysfm

int main() {
  if (!std::filesystem::exists(raysfm::testing_support::shared_data("boards"))) {
    std::printf("no shared data: boards (set RAYSFM_SHARED_DATA)\n");
    return 0;
  }
  raysfm::run();
}
