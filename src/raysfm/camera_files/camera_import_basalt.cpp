#include <fmt/format.h>

#include <cmath>

#include "raysfm/camera_files/camera_import.h"

namespace raysfm {
namespace {

std::vector<double> named_numbers(const ConfigField& field, std::initializer_list<const char*> names) {
  std::vector<double> numbers;
  for (const char* name : names) numbers.push_back(field.at(name).number());
  return numbers;
}

CameraModel read_model(const ConfigField& camera, const Camera& image, std::string* note) {
  const std::string type = camera.at("camera_type").text();
  const ConfigField field = camera.at("intrinsics");
  const auto numbers = [&](std::initializer_list<const char*> more) {
    std::vector<double> all = named_numbers(field, {"fx", "fy", "cx", "cy"});
    const std::vector<double> rest = named_numbers(field, more);
    all.insert(all.end(), rest.begin(), rest.end());
    return all;
  };
  if (type == "pinhole") return perspective_model(numbers({}));
  if (type == "pinhole-radtan8") {
    return perspective_model(numbers({"k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"}));
  }
  if (type == "kb4") return model_from<KannalaBrandt>(numbers({"k1", "k2", "k3", "k4"}));
  if (type == "ds") return model_from<DoubleSphere>(numbers({"xi", "alpha"}));
  if (type == "eucm") return model_from<Eucm>(numbers({"alpha", "beta"}));
  if (type == "ucm") {
    std::vector<double> n = numbers({"alpha"});
    n.push_back(1);  // eucm with beta = 1
    return model_from<Eucm>(n);
  }
  if (type == "fov") return fov_model(numbers({"w"}), image.width, image.height, field.at("w"), note);
  camera.at("camera_type").report("pinhole, pinhole-radtan8, kb4, ds, ucm, eucm, fov");
  return Pinhole{};
}

Rigid3 read_imu_from_cam(const ConfigField& field) {
  const std::vector<double> t = named_numbers(field, {"px", "py", "pz"});
  const std::vector<double> q = named_numbers(field, {"qw", "qx", "qy", "qz"});
  const Eigen::Quaterniond rotation(q[0], q[1], q[2], q[3]);
  if (!(std::abs(rotation.norm() - 1) < 1e-3)) {
    field.problem().report(field.name(), fmt::format("a quaternion of length {:.6g}", rotation.norm()),
                           "qx, qy, qz, qw of length 1");
    return {};
  }
  return {rotation.normalized(), Eigen::Vector3d(t[0], t[1], t[2])};
}

}  // namespace

Rig import_basalt(const ConfigField& root, std::string* note) {
  const ConfigField value = root.at("value0");
  const std::vector<ConfigField> poses = value.at("T_imu_cam").list();
  const std::vector<ConfigField> intrinsics = value.at("intrinsics").list();
  const std::vector<ConfigField> sizes = value.at("resolution").list();
  if (poses.size() != intrinsics.size() || sizes.size() != intrinsics.size()) {
    value.problem().report(
        "value0",
        fmt::format("{} poses, {} intrinsics, {} resolutions", poses.size(), intrinsics.size(), sizes.size()),
        "as many of each");
    return {};
  }
  Rig rig;
  Rigid3 cam0_from_imu;
  for (size_t i = 0; i < intrinsics.size(); ++i) {
    Camera camera;
    camera.name = fmt::format("cam{}", i);
    camera.stream = static_cast<int>(i);
    read_resolution(sizes[i], &camera);
    camera.model = read_model(intrinsics[i], camera, note);
    if (!value.problem().any()) check_intrinsics(camera.model, intrinsics[i].at("intrinsics"));
    const Rigid3 imu_from_cam = read_imu_from_cam(poses[i]);
    if (i == 0) cam0_from_imu = imu_from_cam.inverse();
    camera.rig_from_cam = i == 0 ? Rigid3{} : cam0_from_imu * imu_from_cam;
    rig.cameras.push_back(std::move(camera));
  }
  return rig;
}

}  // namespace raysfm
