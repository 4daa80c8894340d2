#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <numeric>
#include <optional>

#include "raysfm/camera_files/camera_convert.h"
#include "raysfm/colmap_bal/colmap_model.h"
#include "raysfm/exports/scene_formats.h"
#include "raysfm/files/atomic_file.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr int32_t kLastModelOf38 = 10;  // of COLMAP 3.8: later ones it refuses with the whole file

std::optional<ColmapCamera> as_colmap(const Camera& camera) {
  for (const CameraModel& model : equivalent_models(camera.model)) {
    std::optional<ColmapCamera> colmap = colmap_camera(model);
    if (!colmap || colmap->model > kLastModelOf38) continue;
    colmap->width = camera.width;
    colmap->height = camera.height;
    return colmap;
  }
  return std::nullopt;
}

ColmapImage as_colmap(const ExportImage& image, uint32_t id) {
  const Rigid3 cam_from_world = image.world_from_cam.inverse();
  const Eigen::Quaterniond& q = cam_from_world.rotation;
  const Eigen::Vector3d& t = cam_from_world.translation;
  ColmapImage colmap;
  colmap.id = id;
  colmap.rotation = {q.w(), q.x(), q.y(), q.z()};
  colmap.translation = {t.x(), t.y(), t.z()};
  colmap.camera_id = static_cast<uint32_t>(image.camera + 1);
  colmap.name = image.name;
  return colmap;
}

// Points, each with the keypoints that are its own.
void add_points(const ExportScene& scene, ColmapModel* model) {
  std::vector<size_t> next(scene.points.size() + 1, 0);
  for (const ExportImage& image : scene.images) {
    for (const ExportKeypoint& k : image.keypoints) ++next[k.point + 1];
  }
  std::partial_sum(next.begin(), next.end(), next.begin());
  const std::vector<double> errors = point_errors(scene);
  for (size_t p = 0; p < scene.points.size(); ++p) {
    model->points.push_back(
        {p + 1, scene.points[p].position, scene.points[p].rgb, errors[p], next[p], next[p + 1]});
  }
  model->elements.resize(next.back());
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const std::vector<ExportKeypoint>& keypoints = scene.images[i].keypoints;
    for (size_t k = 0; k < keypoints.size(); ++k) {
      model->elements[next[keypoints[k].point]++] = {static_cast<uint32_t>(i + 1), static_cast<uint32_t>(k),
                                                     static_cast<int>(i)};
    }
  }
}

// For COLMAP's rig_configurator: cameras are told apart by the folders of their images.
std::string rig_config(const ExportScene& scene) {
  const Rigid3 reference_from_rig = scene.cameras.front().rig_from_cam.inverse();
  Json cameras = Json::array();
  for (size_t c = 0; c < scene.cameras.size(); ++c) {
    const std::string& name = scene.images[c].name;
    Json camera = {{"image_prefix", name.substr(0, name.rfind('/') + 1)}};
    if (c == 0) {
      camera["ref_sensor"] = true;
    } else {
      const Rigid3 cam_from_reference = (reference_from_rig * scene.cameras[c].rig_from_cam).inverse();
      const Eigen::Quaterniond& q = cam_from_reference.rotation;
      const Eigen::Vector3d& t = cam_from_reference.translation;
      camera["cam_from_rig_rotation"] = {q.w(), q.x(), q.y(), q.z()};
      camera["cam_from_rig_translation"] = {t.x(), t.y(), t.z()};
    }
    cameras.push_back(std::move(camera));
  }
  return Json::array({{{"cameras", std::move(cameras)}}}).dump(2, ' ', true, Json::error_handler_t::replace) +
         "\n";
}

}  // namespace

Result<void> colmap_holds(const Camera& camera) {
  if (camera.width <= 0 || camera.height <= 0) return bad_input("the size of its images is not known");
  if (as_colmap(camera)) return {};
  return bad_input("pinhole, radtan, rational and kannala-brandt cameras are held");
}

Result<void> write_colmap(const ExportScene& scene, bool text, const fs::path& folder) {
  ColmapModel model;
  model.binary = !text;
  for (const Camera& camera : scene.cameras) {
    std::optional<ColmapCamera> colmap = as_colmap(camera);
    colmap->id = static_cast<uint32_t>(model.cameras.size() + 1);
    model.cameras.push_back(*std::move(colmap));
  }
  for (const ExportImage& image : scene.images) {
    if (text && image.name.find_first_of(" \t\r\n") != std::string::npos) {
      return bad_input(fmt::format(
          "image '{}': COLMAP's text cannot hold a space in a name, its binary form can", image.name));
    }
    ColmapImage colmap = as_colmap(image, static_cast<uint32_t>(model.images.size() + 1));
    colmap.first_keypoint = model.keypoints.size();
    for (const ExportKeypoint& k : image.keypoints) {
      model.keypoints.push_back({k.pixel.x() + kColmapPixelOrigin, k.pixel.y() + kColmapPixelOrigin,
                                 static_cast<uint64_t>(k.point + 1)});
    }
    colmap.last_keypoint = model.keypoints.size();
    colmap.camera = image.camera;
    model.images.push_back(std::move(colmap));
  }
  add_points(scene, &model);
  if (auto written = write_colmap_model(model, folder / "sparse" / "0"); !written) return written;
  if (!scene.rig || scene.cameras.size() < 2 || scene.images.size() < scene.cameras.size()) return {};
  return write_file(folder / "rig_config.json", rig_config(scene));
}

}  // namespace raysfm
