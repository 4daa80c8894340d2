#include <algorithm>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>
#include <variant>

#include "raysfm/camera_files/camera_convert.h"
#include "raysfm/exports/scene_formats.h"
#include "raysfm/files/atomic_file.h"
#include "raysfm/results/ply_file.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr double kPixelOrigin = 0.5;  // nerfstudio samples the first pixel at (0.5, 0.5)

// x, z, -y: the vertical of a level camera is up.
Eigen::Matrix<double, 3, 4> nerfstudio_from_world() {
  Eigen::Matrix<double, 3, 4> matrix;
  matrix << 1, 0, 0, 0,  //
      0, 0, 1, 0,        //
      0, -1, 0, 0;
  return matrix;
}

Json intrinsics(const char* kind, const Camera& camera, double fx, double fy, double cx, double cy) {
  return {{"camera_model", kind},    {"fl_x", fx},        {"fl_y", fy},        {"cx", cx + kPixelOrigin},
          {"cy", cy + kPixelOrigin}, {"w", camera.width}, {"h", camera.height}};
}

// Null where the format has no such model.
Json as_nerfstudio(const Camera& camera) {
  for (const CameraModel& model : equivalent_models(camera.model)) {
    if (const auto* m = std::get_if<Radtan>(&model)) {
      Json json = intrinsics("OPENCV", camera, m->fx, m->fy, m->cx, m->cy);
      json.update({{"k1", m->k1}, {"k2", m->k2}, {"k3", m->k3}, {"p1", m->p1}, {"p2", m->p2}});
      return json;
    }
    if (const auto* m = std::get_if<KannalaBrandt>(&model)) {
      Json json = intrinsics("OPENCV_FISHEYE", camera, m->fx, m->fy, m->cx, m->cy);
      json.update({{"k1", m->k1}, {"k2", m->k2}, {"k3", m->k3}, {"k4", m->k4}});
      return json;
    }
  }
  return {};
}

template <typename Matrix>
Json rows_of(const Matrix& matrix) {
  Json rows = Json::array();
  for (int r = 0; r < matrix.rows(); ++r) {
    Json& row = rows.emplace_back(Json::array());
    for (int c = 0; c < matrix.cols(); ++c) row.push_back(matrix(r, c));
  }
  return rows;
}

// Of a camera that looks along -z with y up.
Json transform_matrix(const Rigid3& world_from_cam) {
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity(), applied = Eigen::Matrix4d::Identity();
  matrix.topLeftCorner<3, 3>() = world_from_cam.rotation.toRotationMatrix();
  matrix.topRightCorner<3, 1>() = world_from_cam.translation;
  matrix.middleCols<2>(1) *= -1;
  applied.topRows<3>() = nerfstudio_from_world();
  return rows_of(Eigen::Matrix4d(applied * matrix));
}

Result<void> write_points(const ExportScene& scene, const fs::path& path) {
  const Eigen::Matrix3d turn = nerfstudio_from_world().leftCols<3>();
  Reconstruction turned;
  turned.points = scene.points;
  for (MapPoint& point : turned.points) point.position = turn * point.position;
  return write_points_ply(turned, path);
}

}  // namespace

Result<void> nerfstudio_holds(const Camera& camera) {
  if (camera.width <= 0 || camera.height <= 0) return bad_input("the size of its images is not known");
  if (!as_nerfstudio(camera).is_null()) return {};
  return bad_input("pinhole, radtan and kannala-brandt cameras are held");
}

Result<void> write_nerfstudio(const ExportScene& scene, const fs::path& folder) {
  std::vector<Json> cameras;
  for (const Camera& camera : scene.cameras) cameras.push_back(as_nerfstudio(camera));
  const auto kind = [](const Json& camera) { return camera.at("camera_model"); };
  const auto is_first = [&](const Json& camera) { return camera == cameras.front(); };
  const bool one_camera = std::ranges::all_of(cameras, is_first);
  Json json;
  if (!cameras.empty()) {
    if (std::ranges::any_of(cameras, [&](const Json& camera) { return kind(camera) != kind(cameras[0]); })) {
      return bad_input(
          "nerfstudio has one camera model for all, here some cameras are fisheyes and some are not; "
          "--undistort makes all of them pinholes");
    }
    json["camera_model"] = kind(cameras[0]);
    if (one_camera) json = cameras[0];
  }
  json["applied_transform"] = rows_of(nerfstudio_from_world());
  json["ply_file_path"] = "points.ply";
  Json& frames = json["frames"] = Json::array();
  for (const ExportImage& image : scene.images) {
    Json frame = {{"file_path", "images/" + image.name}};
    if (!one_camera) frame.update(cameras[image.camera]);
    frame.erase("camera_model");
    frame["transform_matrix"] = transform_matrix(image.world_from_cam);
    frames.push_back(std::move(frame));
  }
  std::string text;
  try {
    text = json.dump(1) + "\n";
  } catch (const Json::exception&) {
    return bad_input("the name of an image is not UTF-8, which transforms.json cannot hold");
  }
  if (auto written = write_points(scene, folder / "points.ply"); !written) return written;
  return write_file(folder / "transforms.json", text);
}

}  // namespace raysfm
