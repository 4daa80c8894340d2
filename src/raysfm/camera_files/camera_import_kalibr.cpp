#include <fmt/format.h>

#include "raysfm/camera_files/camera_import.h"

namespace raysfm {
namespace {

// The coefficients of a camera's distortion, `low` to `high` of them.
std::vector<double> read_coefficients(const ConfigField& camera, size_t low, size_t high, const char* names) {
  const ConfigField field = camera.any_of({"distortion_coeffs", "distortion_coefficients"});
  std::vector<double> coefficients = field.numbers();
  if (coefficients.size() < low || coefficients.size() > high) {
    field.problem().report(field.name(), fmt::format("{} numbers", coefficients.size()), names);
    coefficients.assign(low, 0);
  }
  return coefficients;
}

std::vector<double> joined(std::vector<double> a, const std::vector<double>& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

CameraModel read_pinhole(const ConfigField& camera, const std::string& distortion, std::string* note) {
  const std::vector<double> f = camera.at("intrinsics").numbers(4);
  if (distortion == "none") return perspective_model(f);
  if (distortion == "radtan" || distortion == "radial-tangential" || distortion == "plumb_bob") {
    return perspective_model(
        joined(f, read_coefficients(camera, 4, 5, "4 or 5 numbers: k1, k2, p1, p2[, k3]")));
  }
  if (distortion == "equidistant") {
    return model_from<KannalaBrandt>(joined(f, read_coefficients(camera, 4, 4, "4 numbers: k1, k2, k3, k4")));
  }
  if (distortion == "fov") {
    Camera image;
    read_resolution(camera.at("resolution"), &image);
    return fov_model(joined(f, read_coefficients(camera, 1, 1, "1 number: omega")), image.width, image.height,
                     camera.any_of({"distortion_coeffs", "distortion_coefficients"}), note);
  }
  camera.at("distortion_model").report("radtan, equidistant, fov, none");
  return Pinhole{};
}

CameraModel read_omni(const ConfigField& camera, const std::string& distortion) {
  const std::vector<double> n = camera.at("intrinsics").numbers(5);
  const std::vector<double> numbers = {n[1], n[2], n[3], n[4], n[0]};
  if (distortion == "none") return model_from<Unified>(numbers);
  if (distortion != "radtan") camera.at("distortion_model").report("radtan, none (with camera_model omni)");
  if (camera.problem().any()) return Pinhole{};
  return model_from<Unified>(joined(numbers, read_coefficients(camera, 4, 4, "4 numbers: k1, k2, p1, p2")));
}

CameraModel read_model(const ConfigField& camera, std::string* note) {
  const std::string projection = camera.at("camera_model").text();
  const ConfigField kind = camera.at("distortion_model");
  const std::string distortion = kind.exists() ? kind.text() : "none";
  CameraModel model;
  if (projection == "pinhole") {
    model = read_pinhole(camera, distortion, note);
  } else if (projection == "omni") {
    model = read_omni(camera, distortion);
  } else if (projection == "ds" || projection == "eucm") {
    const std::vector<double> n = camera.at("intrinsics").numbers(6);
    const std::vector<double> numbers = {n[2], n[3], n[4], n[5], n[0], n[1]};
    if (distortion != "none") kind.report("none (with camera_model " + projection + ")");
    model = projection == "ds" ? CameraModel(model_from<DoubleSphere>(numbers)) : model_from<Eucm>(numbers);
  } else {
    camera.at("camera_model").report("pinhole, omni, ds, eucm");
  }
  if (camera.problem().any()) return Pinhole{};
  check_intrinsics(model, camera.at("intrinsics"));
  return model;
}

// Motion from the IMU to the camera where the file has it.
std::optional<Rigid3> cam_from_imu(const ConfigField& camera) {
  if (camera.at("T_cam_imu").exists()) return camera.at("T_cam_imu").rigid_matrix();
  if (camera.at("T_imu_cam").exists()) return camera.at("T_imu_cam").rigid_matrix().inverse();
  return std::nullopt;
}

}  // namespace

Rig import_kalibr(const ConfigField& root, std::string* note) {
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
    camera.model = read_model(field, note);
    read_resolution(field.at("resolution"), &camera);
    const std::optional<Rigid3> camn_from_imu = cam_from_imu(field);
    const ConfigField chain = field.any_of({"T_cn_cnm1", "baseline_last_to_this_cam"});
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

Rig import_euroc(const ConfigField& root, std::string* note) {
  Camera camera;
  camera.name = "cam0";
  camera.model = read_model(root, note);
  read_resolution(root.at("resolution"), &camera);
  if (root.at("T_BS").exists()) camera.rig_from_cam = root.at("T_BS").rigid_matrix();
  return Rig{{std::move(camera)}};
}

}  // namespace raysfm
