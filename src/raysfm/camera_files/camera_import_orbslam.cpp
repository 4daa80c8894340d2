#include "raysfm/camera_files/camera_settings.h"

namespace raysfm {
namespace {

CameraModel read_model(const ConfigField& root, const std::string& section, const std::string& type) {
  std::vector<double> numbers = focal_settings(root, section);
  const std::vector<double> d = type == "KannalaBrandt8"
                                    ? optional_settings(root, section, {"k1", "k2", "k3", "k4"})
                                    : optional_settings(root, section, {"k1", "k2", "p1", "p2", "k3"});
  numbers.insert(numbers.end(), d.begin(), d.end());
  if (root.problem().any()) return Pinhole{};
  const CameraModel model =
      type == "KannalaBrandt8" ? CameraModel(model_from<KannalaBrandt>(numbers)) : perspective_model(numbers);
  check_intrinsics(model, ConfigField(nullptr, section, &root.problem()));
  return model;
}

// A depth camera's files carry the baseline of a pair that is not there.
bool has_depth(const ConfigField& root) {
  return root.at("DepthMapFactor").exists() || root.at("RGBD.DepthMapFactor").exists();
}

Rig read_stereo(const ConfigField& root, const std::string& section, const std::string& type, Camera camera,
                std::string* note) {
  const ConfigField pose = root.any_of({"Stereo.T_c1_c2", "Tlr"});
  if (pose.exists() && setting(root, "Camera2", "fx").exists()) {
    Camera second = camera;
    camera.name = "camera1";
    second.name = "camera2";
    second.stream = 1;
    second.model = read_model(root, "Camera2", type);
    second.rig_from_cam = pose.rigid_matrix();  // takes points from camera 2 to camera 1
    return Rig{{std::move(camera), std::move(second)}};
  }
  const ConfigField product = root.at("Camera.bf"), length = root.at("Stereo.b");
  if (!product.exists() && !length.exists()) return Rig{{std::move(camera)}};
  if (has_depth(root)) {
    add_note(note, "settings of a depth camera: its one camera is read");
    return Rig{{std::move(camera)}};
  }
  const double baseline =
      length.exists() ? length.number() : product.number() / setting(root, section, "fx").number();
  if (root.problem().any()) return {};
  if (!(baseline > 0)) (length.exists() ? length : product).report("a number above 0");
  if (!root.at("LEFT.K").exists()) return rectified_pair(std::move(camera), baseline);
  add_note(note, "read as the two cameras before rectification");
  const auto side = [&](const std::string& name) {
    return UnrectifiedCamera{root.at(name + ".K"), root.at(name + ".D"), root.at(name + ".R")};
  };
  return unrectified_pair(side("LEFT"), side("RIGHT"), baseline, camera);
}

}  // namespace

Rig import_orbslam(const ConfigField& root, std::string* note) {
  const std::string section = setting(root, "Camera1", "fx").exists() ? "Camera1" : "Camera";
  const ConfigField type_field = root.at("Camera.type");
  const std::string type = type_field.exists() ? type_field.text() : "PinHole";
  if (type != "PinHole" && type != "KannalaBrandt8" && type != "Rectified") {
    type_field.report("PinHole, KannalaBrandt8, Rectified");
  }
  Camera camera;
  camera.name = "camera";
  // Not every file says the size; it is taken from the images then.
  if (root.at("Camera.width").exists()) {
    camera.width = root.at("Camera.width").integer(1, kMaxImageSide);
    camera.height = root.at("Camera.height").integer(1, kMaxImageSide);
  }
  camera.model = read_model(root, section, type);
  if (root.problem().any()) return {};
  return read_stereo(root, section, type, std::move(camera), note);
}

}  // namespace raysfm
