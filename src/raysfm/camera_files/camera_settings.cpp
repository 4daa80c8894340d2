#include "raysfm/camera_files/camera_settings.h"

namespace raysfm {

ConfigField setting(const ConfigField& root, const std::string& section, const std::string& key) {
  const ConfigField nested = root.at(section).at(key);
  return nested.exists() ? nested : root.at(section + "." + key);
}

std::vector<double> optional_settings(const ConfigField& root, const std::string& section,
                                      std::initializer_list<const char*> keys) {
  std::vector<double> numbers;
  for (const char* key : keys) {
    const ConfigField field = setting(root, section, key);
    numbers.push_back(field.exists() ? field.number() : 0);
  }
  return numbers;
}

std::vector<double> focal_settings(const ConfigField& root, const std::string& section) {
  std::vector<double> numbers;
  for (const char* key : {"fx", "fy", "cx", "cy"}) numbers.push_back(setting(root, section, key).number());
  return numbers;
}

namespace {

CameraModel read_model(const UnrectifiedCamera& camera) {
  const std::vector<double> k = camera.k.numbers(9);
  std::vector<double> numbers = {k[0], k[4], k[2], k[5]};
  const std::vector<double> d = camera.d.numbers();
  numbers.insert(numbers.end(), d.begin(), d.end());
  if (camera.k.problem().any()) return Pinhole{};
  if (camera.fisheye ? d.size() != 4 : d.size() < 4 || d.size() > 5) {
    camera.d.report(camera.fisheye ? "4 numbers: k1, k2, k3, k4" : "4 or 5 numbers: k1, k2, p1, p2[, k3]");
    return Pinhole{};
  }
  const CameraModel model =
      camera.fisheye ? CameraModel(model_from<KannalaBrandt>(numbers)) : perspective_model(numbers);
  check_intrinsics(model, camera.k);
  return model;
}

Eigen::Quaterniond read_rectification(const ConfigField& field) {
  const std::vector<double> r = field.numbers(9);
  const auto rotation =
      nearest_rotation(Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(r.data()));
  if (!rotation) field.report("a 3 x 3 rotation matrix");
  return rotation.value_or(Eigen::Quaterniond::Identity());
}

}  // namespace

Rig unrectified_pair(const UnrectifiedCamera& left, const UnrectifiedCamera& right, double baseline,
                     const Camera& image) {
  Camera first = image, second = image;
  first.name = "left";
  first.model = read_model(left);
  second.name = "right";
  second.stream = 1;
  second.model = read_model(right);
  const Rigid3 rectified_from_first{read_rectification(left.r), Eigen::Vector3d::Zero()};
  const Rigid3 rectified_from_second{read_rectification(right.r), Eigen::Vector3d(baseline, 0, 0)};
  second.rig_from_cam = rectified_from_first.inverse() * rectified_from_second;
  return Rig{{std::move(first), std::move(second)}};
}

Rig rectified_pair(Camera left, double baseline) {
  left.name = "left";
  Camera right = left;
  right.name = "right";
  right.stream = 1;
  right.rig_from_cam.translation = {baseline, 0, 0};
  return Rig{{std::move(left), std::move(right)}};
}

}  // namespace raysfm
