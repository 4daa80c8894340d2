#include "raysfm/camera_files/camera_settings.h"

namespace raysfm {
namespace {

CameraModel read_model(const ConfigField& root, const Camera& image) {
  const ConfigField name = setting(root, "Camera", "model");
  const std::string model = name.text();
  if (model == "equirectangular") return Equirectangular::for_image(image.width, image.height);
  std::vector<double> numbers = focal_settings(root, "Camera");
  const auto with = [&](std::initializer_list<const char*> keys) {
    const std::vector<double> more = optional_settings(root, "Camera", keys);
    numbers.insert(numbers.end(), more.begin(), more.end());
    return numbers;
  };
  if (model == "perspective") return perspective_model(with({"k1", "k2", "p1", "p2", "k3"}));
  if (model == "fisheye") return model_from<KannalaBrandt>(with({"k1", "k2", "k3", "k4"}));
  if (model == "radial_division") {
    const double k = with({"distortion"}).back();
    const auto division = division_model(numbers[0], numbers[1], numbers[2], numbers[3], k);
    if (!division) setting(root, "Camera", "distortion").report("a number of at most 0");
    return division.value_or(Pinhole{});
  }
  name.report("perspective, fisheye, equirectangular, radial_division");
  return Pinhole{};
}

}  // namespace

Rig import_stella(const ConfigField& root, std::string* note) {
  Camera camera;
  camera.name = "camera";
  camera.width = setting(root, "Camera", "cols").integer(1, kMaxImageSide);
  camera.height = setting(root, "Camera", "rows").integer(1, kMaxImageSide);
  const ConfigField setup = setting(root, "Camera", "setup");
  const bool stereo = setup.exists() && setup.text() == "stereo";
  camera.model = read_model(root, camera);
  if (root.problem().any()) return {};
  check_intrinsics(camera.model, root.at("Camera"));
  if (!stereo) return Rig{{std::move(camera)}};

  // -P2(0, 3) of the rectification: focal length times baseline.
  const ConfigField product = setting(root, "Camera", "focal_x_baseline");
  const double baseline = product.number() / setting(root, "Camera", "fx").number();
  if (root.problem().any()) return {};
  if (!(baseline > 0)) product.report("a number above 0");
  if (!setting(root, "StereoRectifier", "K_left").exists())
    return rectified_pair(std::move(camera), baseline);
  add_note(note, "read as the two cameras before rectification");
  const auto side = [&](const std::string& name) {
    const ConfigField model = setting(root, "StereoRectifier", "model");
    return UnrectifiedCamera{
        setting(root, "StereoRectifier", "K_" + name), setting(root, "StereoRectifier", "D_" + name),
        setting(root, "StereoRectifier", "R_" + name), model.exists() && model.text() == "fisheye"};
  };
  return unrectified_pair(side("left"), side("right"), baseline, camera);
}

}  // namespace raysfm
