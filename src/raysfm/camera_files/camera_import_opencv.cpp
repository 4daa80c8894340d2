#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>

#include "raysfm/camera_files/camera_import.h"

namespace raysfm {
namespace {

enum class Kind { kPerspective, kFisheye, kOmnidir };

// The fields of one camera.
struct CameraFields {
  ConfigField matrix, distortion, xi;
};

// fx fy cx cy
std::vector<double> read_matrix(const ConfigField& matrix) {
  const std::vector<double> k = matrix.numbers(9);
  const bool upper = k[3] == 0 && k[6] == 0 && k[7] == 0 && k[8] == 1;
  if (!upper || k[1] != 0) matrix.report("a 3 x 3 matrix fx 0 cx, 0 fy cy, 0 0 1");
  return {k[0], k[4], k[2], k[5]};
}

std::vector<double> read_perspective_coefficients(const ConfigField& field, std::string* note) {
  std::vector<double> d = field.numbers();
  // OpenCV's thin prism and tilt coefficients, twelve or fourteen in all, are usually zero.
  while (d.size() > 8 && d.size() <= 14 && d.back() == 0) d.pop_back();
  if (d.size() > 8 || (d.size() > 5 && d.size() < 8) || (d.size() > 0 && d.size() < 4)) {
    field.report(
        "0, 4, 5 or 8 coefficients: k1, k2, p1, p2[, k3[, k4, k5, k6]]; "
        "thin prism and tilt must be zero");
  }
  if (d.size() == 4) {
    add_note(note, fmt::format("{} read as k1, k2, p1, p2; for coefficients of OpenCV's fisheye add "
                               "'fisheye_model: 1' to the file",
                               field.name()));
  }
  return d;
}

CameraModel read_model(const CameraFields& camera, Kind kind, std::string* note) {
  std::vector<double> numbers = read_matrix(camera.matrix);
  if (kind == Kind::kOmnidir) numbers.push_back(camera.xi.numbers(1).front());
  if (camera.distortion.exists()) {
    const std::vector<double> d = kind == Kind::kPerspective
                                      ? read_perspective_coefficients(camera.distortion, note)
                                      : camera.distortion.numbers(4);
    numbers.insert(numbers.end(), d.begin(), d.end());
  }
  if (camera.matrix.problem().any()) return Pinhole{};
  CameraModel model;
  switch (kind) {
    case Kind::kPerspective:
      model = perspective_model(numbers);
      break;
    case Kind::kFisheye:
      model = model_from<KannalaBrandt>(numbers);
      break;
    case Kind::kOmnidir:
      model = model_from<Unified>(numbers);
      break;
  }
  check_intrinsics(model, camera.matrix);
  return model;
}

void read_size(const ConfigField& root, Camera* camera) {
  const ConfigField width = root.any_of({"image_width", "image_Width", "imageWidth", "width"});
  const ConfigField height = root.any_of({"image_height", "image_Height", "imageHeight", "height"});
  const ConfigField both = root.any_of({"image_size", "imageSize", "img_size", "size", "resolution"});
  if (width.exists() || height.exists()) {
    camera->width = width.integer(1, kMaxImageSide);
    camera->height = height.integer(1, kMaxImageSide);
  } else if (both.exists()) {
    const std::vector<double> sides = both.numbers(2);
    const auto side = [&](double v) { return v >= 1 && v <= kMaxImageSide && v == static_cast<int>(v); };
    if (!side(sides[0]) || !side(sides[1])) return both.report("[width, height] in pixels");
    camera->width = static_cast<int>(sides[0]);
    camera->height = static_cast<int>(sides[1]);
  }
}

Kind read_kind(const ConfigField& root, const CameraFields& camera) {
  if (camera.xi.exists()) return Kind::kOmnidir;
  const ConfigField fisheye = root.at("fisheye_model");
  const ConfigField name = root.any_of({"distortion_model", "camera_model"});
  if (fisheye.exists() && fisheye.integer(0, 1) == 1) return Kind::kFisheye;
  if (!name.exists()) return Kind::kPerspective;
  const std::string model = name.text();
  if (model == "equidistant" || model == "fisheye") return Kind::kFisheye;
  if (model != "plumb_bob" && model != "rational_polynomial" && model != "pinhole" &&
      model != "perspective") {
    name.report("plumb_bob, rational_polynomial, equidistant, fisheye");
  }
  return Kind::kPerspective;
}

std::optional<Eigen::Quaterniond> read_rotation(const ConfigField& field) {
  const std::vector<double> r = field.numbers();
  if (r.size() == 3) {
    const Eigen::Vector3d v(r[0], r[1], r[2]);
    if (v.norm() == 0) return Eigen::Quaterniond::Identity();
    return Eigen::Quaterniond(Eigen::AngleAxisd(v.norm(), v.normalized()));
  }
  if (r.size() != 9) return std::nullopt;
  return nearest_rotation(Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(r.data()));
}

Rigid3 read_second_from_first(const ConfigField& r, const ConfigField& t) {
  const std::optional<Eigen::Quaterniond> rotation = read_rotation(r);
  if (!rotation) r.report("a 3 x 3 rotation matrix, or a rotation vector");
  const std::vector<double> translation = t.numbers(3);
  if (!rotation) return {};
  return {*rotation, Eigen::Vector3d(translation[0], translation[1], translation[2])};
}

CameraFields first_fields(const ConfigField& root) {
  return {root.any_of({"camera_matrix", "cameraMatrix", "Camera_Matrix", "K", "M", "M1", "K1",
                       "cameraMatrix1", "camera_matrix_1", "left_camera_matrix"}),
          root.any_of({"distortion_coefficients", "dist_coeffs", "distCoeffs", "distortion_coeffs",
                       "Distortion_Coefficients", "D", "D1", "distCoeffs1", "dist_coeffs_1",
                       "distortion_coefficients_1", "left_distortion_coefficients"}),
          root.any_of({"xi", "xi1", "xi_1"})};
}

CameraFields second_fields(const ConfigField& root) {
  return {root.any_of({"M2", "K2", "cameraMatrix2", "camera_matrix_2", "right_camera_matrix"}),
          root.any_of({"D2", "distCoeffs2", "dist_coeffs_2", "distortion_coefficients_2",
                       "right_distortion_coefficients"}),
          root.any_of({"xi2", "xi_2"})};
}

}  // namespace

Rig import_opencv(const ConfigField& root, std::string* note) {
  const CameraFields first = first_fields(root), second = second_fields(root);
  const ConfigField r = root.any_of({"R", "rvec", "om"}), t = root.any_of({"T", "tvec"});
  Rig rig;
  Camera camera;
  camera.name = second.matrix.exists() ? "left" : "camera";
  camera.model = read_model(first, read_kind(root, first), note);
  read_size(root, &camera);
  rig.cameras.push_back(camera);
  if (second.matrix.exists() && r.exists() && t.exists()) {
    camera.name = "right";
    camera.stream = 1;
    camera.model = read_model(second, read_kind(root, second), note);
    camera.rig_from_cam = read_second_from_first(r, t).inverse();
    rig.cameras.push_back(camera);
  } else if (second.matrix.exists()) {
    add_note(note, fmt::format("{} left out: the file has no R and T that say where the second camera is",
                               second.matrix.name()));
  }
  return rig;
}

}  // namespace raysfm
