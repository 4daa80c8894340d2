#include "raysfm/exports/undistort.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>

#include "raysfm/core/median.h"
#include "raysfm/scene/frame_lens.h"

namespace raysfm {
namespace {

constexpr int kGrid = 24;  // rays per axis that a camera, or a face, is looked at with
constexpr double kWidestPinhole = 60 * std::numbers::pi / 180;
constexpr double kLeastOfFace = 0.05;  // of a face that is kept
constexpr int kLargestFace = 8192;     // pixels

Eigen::Vector2d grid_pixel(const Camera& camera, int i, int j) {
  return {(camera.width - 1.0) * i / (kGrid - 1), (camera.height - 1.0) * j / (kGrid - 1)};
}

struct Face {
  const char* name;  // empty: the only one
  Eigen::Matrix3d source_from_face;
};

// Columns are the axes of the face: x right, y down, z forward.
Face face_along(const char* name, const Eigen::Vector3d& forward, const Eigen::Vector3d& down) {
  Face face{name, {}};
  face.source_from_face << down.cross(forward), down, forward;
  return face;
}

std::vector<Face> cube() {
  const Eigen::Vector3d x = Eigen::Vector3d::UnitX(), y = Eigen::Vector3d::UnitY(),
                        z = Eigen::Vector3d::UnitZ();
  return {face_along("front", z, y), face_along("right", x, y), face_along("back", -z, y),
          face_along("left", -x, y), face_along("down", y, -z), face_along("up", -y, z)};
}

Camera pinhole(double focal, int width, int height) {
  Camera camera;
  camera.model = Pinhole{focal, focal, (width - 1) / 2.0, (height - 1) / 2.0};
  camera.width = width;
  camera.height = height;
  return camera;
}

// Part of a face that its source sees.
double seen_part(const PinholeSource& source, const Face& face) {
  int seen = 0;
  for (int i = 0; i < kGrid * kGrid; ++i) {
    const double x = 2.0 * (i % kGrid + 0.5) / kGrid - 1, y = 2.0 * (i / kGrid + 0.5) / kGrid - 1;
    Eigen::Vector2d pixel;
    seen += source.pixel(face.source_from_face * Eigen::Vector3d(x, y, 1), &pixel);
  }
  return static_cast<double>(seen) / (kGrid * kGrid);
}

// Distance at which the rays of a camera that do not meet are taken to end: the median of what it sees.
double median_distance(const ExportScene& scene, int camera) {
  constexpr double kFar = 1e3;
  std::vector<double> distances;
  for (const ExportImage& image : scene.images) {
    if (image.camera != camera) continue;
    for (const ExportKeypoint& k : image.keypoints) {
      const double distance = (scene.points[k.point].position - image.world_from_cam.translation).norm();
      if (std::isfinite(distance)) distances.push_back(distance);
    }
  }
  return distances.empty() ? kFar : std::max(1e-9, median_of(&distances));
}

// COLMAP's adjustment ends where a point has one image: some lose theirs beyond the border of a pinhole.
void leave_out_points_of_one_image(ExportScene* scene) {
  std::vector<int> images(scene->points.size(), 0), number(scene->points.size(), -1);
  for (const ExportImage& image : scene->images) {
    for (const ExportKeypoint& k : image.keypoints) ++images[k.point];
  }
  std::vector<MapPoint> kept;
  for (size_t p = 0; p < images.size(); ++p) {
    if (images[p] < 2) continue;
    number[p] = static_cast<int>(kept.size());
    kept.push_back(std::move(scene->points[p]));
  }
  scene->points = std::move(kept);
  for (ExportImage& image : scene->images) {
    std::erase_if(image.keypoints, [&](const ExportKeypoint& k) { return number[k.point] < 0; });
    for (ExportKeypoint& k : image.keypoints) k.point = number[k.point];
  }
}

// Makes the new scene camera by camera, then image by image.
class Undistorter {
 public:
  explicit Undistorter(const ExportScene& from) : from_(from), faces_(from.cameras.size()) {
    to_.scene.rig = from.rig || from.cameras.size() == 1;
    to_.scene.points = from.points;
  }

  Result<void> add_camera(int c) {
    const Camera& camera = from_.cameras[c];
    const std::string who =
        camera.name.empty() ? fmt::format("camera {}", c) : fmt::format("camera '{}'", camera.name);
    if (camera.width <= 0 || camera.height <= 0) {
      return bad_input(fmt::format("{}: the size of its images is not known, --undistort needs it", who));
    }
    const PinholeSource& source = to_.sources.emplace_back(camera, from_.skews[c], median_distance(from_, c));
    if (!(camera.pixels_per_radian() > 0)) return bad_input(fmt::format("{}: no pixel sees anything", who));
    if (source.widest() <= kWidestPinhole) {
      add_face(c, {"", Eigen::Matrix3d::Identity()},
               pinhole(camera.pixels_per_radian(), camera.width, camera.height));
      return {};
    }
    const int size =
        std::clamp(2 * static_cast<int>(std::lround(camera.pixels_per_radian())), 2, kLargestFace);
    for (const Face& face : cube()) {
      if (seen_part(source, face) >= kLeastOfFace) add_face(c, face, pinhole(size / 2.0, size, size));
    }
    if (!faces_[c].empty()) return {};
    return bad_input(fmt::format("{}: no face of a cube sees enough of its images", who));
  }

  void add_image(const ExportImage& image) {
    const size_t first = to_.scene.images.size();
    for (const int face : faces_[image.camera]) {
      ExportImage& made = to_.scene.images.emplace_back();
      made.frame = image.frame;
      made.camera = face;
      made.name = name_of_face(image.name, folders_[face]);
      made.world_from_cam = image.world_from_cam * camera_from_face(face);
    }
    for (const ExportKeypoint& k : image.keypoints) add_keypoint(image, k, first);
  }

  UndistortedScene take() {
    leave_out_points_of_one_image(&to_.scene);
    return std::move(to_);
  }

 private:
  Rigid3 camera_from_face(int face) const {
    return {Eigen::Quaterniond(to_.rotations[face]), to_.sources[to_.source[face]].origin()};
  }

  // A folder for each face. Those of a rig's camera go by its name too: COLMAP tells cameras by how the names
  // of their images begin.
  std::string name_of_face(const std::string& name, const std::string& face) const {
    if (face.empty()) return name;
    const size_t camera = from_.rig && from_.cameras.size() > 1 ? name.find('/') : name.npos;
    return camera == name.npos ? face + "/" + name
                               : name.substr(0, camera) + "_" + face + name.substr(camera);
  }

  void add_face(int c, const Face& face, Camera camera) {
    const Camera& whole = from_.cameras[c];
    faces_[c].push_back(static_cast<int>(to_.scene.cameras.size()));
    folders_.emplace_back(face.name);
    to_.source.push_back(c);
    to_.rotations.push_back(face.source_from_face);
    camera.name = whole.name;
    if (*face.name) camera.name += (whole.name.empty() ? "" : "_") + folders_.back();
    camera.stream = whole.stream;
    camera.rig_from_cam = whole.rig_from_cam * camera_from_face(faces_[c].back());
    to_.scene.cameras.push_back(std::move(camera));
    to_.scene.skews.push_back(0);
  }

  // Into the face that its direction leads through.
  void add_keypoint(const ExportImage& image, const ExportKeypoint& keypoint, size_t first) {
    Eigen::Vector3d direction;
    if (!to_.sources[image.camera].direction(keypoint.pixel, &direction)) return;
    int best = -1;
    double cosine = 0;
    Eigen::Vector2d pixel;
    for (size_t i = first; i < to_.scene.images.size(); ++i) {
      const int face = to_.scene.images[i].camera;
      const Eigen::Vector3d in_face = to_.rotations[face].transpose() * direction;
      Eigen::Vector2d there;
      if (in_face.z() <= cosine || !to_.scene.cameras[face].project(in_face, &there)) continue;
      if (!to_.scene.cameras[face].contains(there)) continue;
      best = static_cast<int>(i);
      cosine = in_face.z();
      pixel = there;
    }
    if (best >= 0) to_.scene.images[best].keypoints.push_back({keypoint.point, pixel});
  }

  const ExportScene& from_;
  UndistortedScene to_;
  std::vector<std::vector<int>> faces_;  // by camera: its cameras in the new scene
  std::vector<std::string> folders_;     // by camera of the new scene
};

}  // namespace

PinholeSource::PinholeSource(const Camera& from, double skew, double distance)
    : camera_(from), finder_(from), skew_(skew), distance_(distance) {
  if (const std::optional<Lens> lens = lens_of(from); lens && skew != 0) {
    fy_ = lens->vector()[1];
    cy_ = lens->vector()[3];
  }
  int seen = 0;
  for (int i = 0; i < kGrid * kGrid; ++i) {
    const Eigen::Vector2d pixel = grid_pixel(camera_, i % kGrid, i / kGrid);
    Ray ray;
    if (!camera_.ray(pixel, &ray)) continue;
    ++seen;
    origin_ += ray.origin;
    widest_ = std::max(widest_, std::acos(std::clamp(ray.direction.z(), -1.0, 1.0)));
  }
  if (seen > 0) origin_ /= seen;
}

double PinholeSource::skew_shift(double v) const {
  return skew_ * (v - cy_) / fy_;
}

bool PinholeSource::pixel(const Eigen::Vector3d& direction, Eigen::Vector2d* pixel) const {
  if (!finder_.find(origin_ + distance_ * direction.normalized(), pixel)) return false;
  pixel->x() += skew_shift(pixel->y());
  return camera_.contains(*pixel);
}

bool PinholeSource::direction(const Eigen::Vector2d& pixel, Eigen::Vector3d* direction) const {
  Ray ray;
  if (!camera_.ray({pixel.x() - skew_shift(pixel.y()), pixel.y()}, &ray)) return false;
  // Where the ray leaves the sphere of that radius about the mean origin.
  const Eigen::Vector3d from_origin = ray.origin - origin_;
  const double along = from_origin.dot(ray.direction);
  const double root = along * along - from_origin.squaredNorm() + distance_ * distance_;
  if (!(root >= 0)) return false;
  *direction = (from_origin + (std::sqrt(root) - along) * ray.direction).normalized();
  return true;
}

Result<UndistortedScene> undistort(const ExportScene& scene) {
  Undistorter undistorter(scene);
  for (size_t c = 0; c < scene.cameras.size(); ++c) {
    if (auto added = undistorter.add_camera(static_cast<int>(c)); !added) return added.error();
  }
  for (const ExportImage& image : scene.images) undistorter.add_image(image);
  return undistorter.take();
}

}  // namespace raysfm
