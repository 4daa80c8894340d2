#include <fmt/format.h>

#include "raysfm/io/camera_import.h"

namespace raysfm {
namespace {

CameraModel read_model(const ConfigField& camera) {
  const std::string model = camera.at("camera_model").text();
  if (model != "pinhole") {
    camera.at("camera_model").report("pinhole (supported models: " + supported_models() + ")");
  }
  const ConfigField distortion = camera.at("distortion_model");
  const std::string kind = distortion.exists() ? distortion.text() : "none";
  std::vector<double> numbers = camera.at("intrinsics").numbers(4);
  if (kind == "radtan" || kind == "radial-tangential" || kind == "plumb_bob") {
    const ConfigField field = camera.any_of({"distortion_coeffs", "distortion_coefficients"});
    const std::vector<double> coefficients = field.numbers();
    if (coefficients.size() != 4 && coefficients.size() != 5)
      field.report("4 or 5 numbers: k1, k2, p1, p2[, k3]");
    numbers.insert(numbers.end(), coefficients.begin(), coefficients.end());
  } else if (kind != "none") {
    distortion.report("radtan, none (supported models: " + supported_models() + ")");
  }
  if (camera.problem().any()) return Pinhole{};
  const CameraModel result = perspective_model(numbers);
  check_intrinsics(result, camera.at("intrinsics"));
  return result;
}

void read_resolution(const ConfigField& field, Camera* camera) {
  const std::vector<ConfigField> sides = field.list();
  if (sides.size() != 2) return field.report("[width, height]");
  camera->width = sides[0].integer(1, kMaxImageSide);
  camera->height = sides[1].integer(1, kMaxImageSide);
}

// Motion from the IMU to the camera where the file has it.
std::optional<Rigid3> cam_from_imu(const ConfigField& camera) {
  if (camera.at("T_cam_imu").exists()) return camera.at("T_cam_imu").rigid_matrix();
  if (camera.at("T_imu_cam").exists()) return camera.at("T_imu_cam").rigid_matrix().inverse();
  return std::nullopt;
}

}  // namespace

Rig import_kalibr(const ConfigField& root) {
  constexpr int kMaxCameras = 64;
  Rig rig;
  std::optional<Rigid3> cam0_from_imu;
  for (int n = 0; n < kMaxCameras; ++n) {
    const std::string name = fmt::format("cam{}", n);
    const ConfigField field = root.at(name);
    if (!field.exists() && n > 0) break;
    Camera camera;
    camera.name = name;
    camera.stream = n;
    camera.model = read_model(field);
    read_resolution(field.at("resolution"), &camera);
    const std::optional<Rigid3> camn_from_imu = cam_from_imu(field);
    const ConfigField chain = field.at("T_cn_cnm1");
    if (n == 0) {
      cam0_from_imu = camn_from_imu;
    } else if (chain.exists()) {
      camera.rig_from_cam = rig.cameras.back().rig_from_cam * chain.rigid_matrix().inverse();
    } else if (cam0_from_imu && camn_from_imu) {
      camera.rig_from_cam = *cam0_from_imu * camn_from_imu->inverse();
    } else {
      chain.report("a 4 x 4 matrix, or T_cam_imu in every camera");
    }
    rig.cameras.push_back(std::move(camera));
  }
  return rig;
}

Rig import_euroc(const ConfigField& root) {
  Camera camera;
  camera.name = "cam0";
  camera.model = read_model(root);
  read_resolution(root.at("resolution"), &camera);
  if (root.at("T_BS").exists()) camera.rig_from_cam = root.at("T_BS").rigid_matrix();
  return Rig{{std::move(camera)}};
}

}  // namespace raysfm
