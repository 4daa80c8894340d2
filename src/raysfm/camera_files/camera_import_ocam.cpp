// The files that hold Scaramuzza's polynomial model.
#include <fmt/format.h>

#include <Eigen/Geometry>
#include <cmath>

#include "raysfm/camera_files/camera_import.h"
#include "raysfm/camera_files/camera_lines.h"

namespace raysfm {
namespace {

constexpr uintmax_t kMaxOcamBytes = 1u << 20;

// What OCamCalib calibrates, in its own axes: x down, y right, z away from the view.
struct OCamCalibration {
  std::vector<double> ss;  // z = ss0 + ss1 rho + ...
  double row = 0, column = 0;
  double c = 1, d = 0, e = 0;  // row = c x + d y + row0, column = e x + y + column0
};

OCam from_calibration(const OCamCalibration& calibration) {
  std::array<double, 5 + OCam::kMaxCoefficients> p{};
  p[0] = calibration.column;
  p[1] = calibration.row;
  p[2] = calibration.c;
  p[3] = calibration.d;
  p[4] = calibration.e;
  for (size_t i = 0; i < calibration.ss.size(); ++i) p[5 + i] = -calibration.ss[i];
  return OCam::from_parameters(p);
}

// Reads a list "N v0 v1 ... " whose first number says how many follow.
std::vector<double> counted(const std::vector<double>& numbers, const ConfigField& field) {
  const size_t count = numbers.empty() ? 0 : numbers.size() - 1;
  if (count < 1 || count > OCam::kMaxCoefficients || numbers[0] != static_cast<double>(count)) {
    field.problem().report(field.name(), fmt::format("{} numbers", numbers.size()),
                           fmt::format("N and N coefficients, N from 1 to {}", OCam::kMaxCoefficients));
    return {0};
  }
  return {numbers.begin() + 1, numbers.end()};
}

// The words of a file from `at` on that belong to one number or group of numbers.
class WordStream {
 public:
  WordStream(std::string_view text, ConfigProblem* problem) : problem_(problem) {
    for (const TextLine& line : content_lines(text)) {
      for (std::string_view word : split_words(line.text)) words_.push_back(word);
    }
  }

  std::vector<double> numbers(size_t count, const std::string& field) {
    if (count > words_.size() - at_) {
      problem_->report(field, fmt::format("{} numbers", words_.size() - at_), fmt::format("{}", count));
      return std::vector<double>(std::min<size_t>(count, 64), 0.0);
    }
    at_ += count;
    return finite_numbers(words_, at_ - count, at_, field, problem_);
  }

  int64_t integer(int64_t low, int64_t high, const std::string& field) {
    const std::string_view word = at_ < words_.size() ? words_[at_++] : std::string_view();
    return integer_word(word, low, high, field, problem_);
  }

 private:
  std::vector<std::string_view> words_;
  size_t at_ = 0;
  ConfigProblem* problem_;
};

}  // namespace

Rig import_ocamcalib(std::string_view text, ConfigProblem* problem) {
  WordStream words(text, problem);
  OCamCalibration calibration;
  const int64_t degree = words.integer(1, OCam::kMaxCoefficients, "number of coefficients");
  calibration.ss = words.numbers(degree, "polynomial");
  const int64_t inverse = words.integer(1, 64, "number of inverse coefficients");
  words.numbers(inverse, "inverse polynomial");
  const std::vector<double> centre = words.numbers(2, "centre");
  const std::vector<double> affine = words.numbers(3, "affine parameters");
  Camera camera;
  camera.name = "camera";
  camera.height = static_cast<int>(words.integer(1, kMaxImageSide, "height"));
  camera.width = static_cast<int>(words.integer(1, kMaxImageSide, "width"));
  if (problem->any()) return {};
  calibration.row = centre[0];
  calibration.column = centre[1];
  calibration.c = affine[0];
  calibration.d = affine[1];
  calibration.e = affine[2];
  camera.model = from_calibration(calibration);
  check_intrinsics(camera.model, ConfigField(nullptr, "polynomial", problem));
  return Rig{{std::move(camera)}};
}

Rig import_omnimvs(const ConfigField& root, std::string* note) {
  Rig rig;
  for (const ConfigField& field : root.at("cameras").list()) {
    OCamCalibration calibration;
    calibration.ss = counted(field.at("poly").numbers(), field.at("poly"));
    const std::vector<double> centre = field.at("center").numbers(2);
    const std::vector<double> affine = field.at("affine").numbers(3);
    const std::vector<ConfigField> size = field.at("image_size").list();
    const std::vector<double> pose = field.at("pose").numbers(6);
    if (size.size() != 2) field.at("image_size").report("[height, width]");
    if (root.problem().any()) return {};
    calibration.row = centre[0];
    calibration.column = centre[1];
    calibration.c = affine[0];
    calibration.d = affine[1];
    calibration.e = affine[2];
    Camera camera;
    camera.stream = static_cast<int>(rig.cameras.size());
    camera.name =
        field.at("cam_id").exists() ? "cam" + field.at("cam_id").text() : fmt::format("cam{}", camera.stream);
    camera.height = size[0].integer(1, kMaxImageSide);
    camera.width = size[1].integer(1, kMaxImageSide);
    camera.model = from_calibration(calibration);
    check_intrinsics(camera.model, field.at("poly"));
    const Eigen::Vector3d rotation(pose[0], pose[1], pose[2]);
    if (rotation.norm() > 0) {
      camera.rig_from_cam.rotation = Eigen::AngleAxisd(rotation.norm(), rotation.normalized());
    }
    camera.rig_from_cam.translation = {pose[3], pose[4], pose[5]};
    if (field.at("invalid_mask").exists() || field.at("max_fov").exists()) {
      add_note(note, "invalid_mask and max_fov are not taken over; give the cameras a mask");
    }
    rig.cameras.push_back(std::move(camera));
  }
  return rig;
}

namespace {

Camera read_multicol_camera(const ConfigField& root) {
  Camera camera;
  camera.name = "camera";
  camera.width = root.at("Camera.Iw").integer(1, kMaxImageSide);
  camera.height = root.at("Camera.Ih").integer(1, kMaxImageSide);
  const int count = root.at("Camera.nrpol").integer(1, OCam::kMaxCoefficients);
  const double c = root.at("Camera.c").number();
  const double d = root.at("Camera.d").number();
  const double e = root.at("Camera.e").number();
  if (!root.problem().any() && !(std::abs(c) > 1e-3)) root.at("Camera.c").report("a number near 1");
  if (root.problem().any()) return camera;
  // Its x runs right and y down: u = c x + d y + u0, v = e x + y + v0. With q = c (x, y) that is the form of
  // OCam, the polynomial scaled with it.
  std::array<double, 5 + OCam::kMaxCoefficients> p{};
  p[0] = root.at("Camera.u0").number();
  p[1] = root.at("Camera.v0").number();
  p[2] = 1 / c;
  p[3] = e / c;
  p[4] = d / c;
  for (int i = 0; i < count; ++i) {
    p[5 + i] = -root.at(fmt::format("Camera.a{}", i)).number() * std::pow(c, 1 - i);
  }
  if (root.problem().any()) return camera;
  camera.model = OCam::from_parameters(p);
  check_intrinsics(camera.model, root.at("Camera.a0"));
  return camera;
}

// M_c of one camera: Cayley parameters and translation.
Rigid3 read_multicol_pose(const ConfigField& root, int number) {
  std::array<double, 6> p{};
  for (int i = 0; i < 6; ++i) p[i] = root.at(fmt::format("CameraSystem.cam{}_{}", number, i + 1)).number();
  return {Eigen::Quaterniond(1, p[0], p[1], p[2]).normalized(), Eigen::Vector3d(p[3], p[4], p[5])};
}

}  // namespace

Rig import_multicol(const ConfigField& root) {
  return Rig{{read_multicol_camera(root)}};
}

Rig import_multicol_rig(const ConfigField& root, const std::filesystem::path& path) {
  const int count = root.at("CameraSystem.nrCams").integer(1, 64);
  Rig rig;
  for (int i = 0; i < count && !root.problem().any(); ++i) {
    const std::filesystem::path file =
        path.parent_path() / fmt::format("InteriorOrientationFisheye{}.yaml", i);
    const Result<std::string> text = read_text_file(file, kMaxOcamBytes);
    const Result<ConfigNode> tree =
        text ? parse_yaml(*text, file.string()) : Result<ConfigNode>(text.error());
    ConfigProblem inside(file.string());
    Camera camera;
    if (tree) camera = read_multicol_camera(ConfigField(&*tree, "", &inside));
    if (!tree || inside.any()) {
      root.problem().report(fmt::format("camera {}", i), tree ? inside.error().message : tree.error().message,
                            "its InteriorOrientationFisheye file in the same folder");
      return {};
    }
    camera.name = fmt::format("cam{}", i);
    camera.stream = i;
    camera.rig_from_cam = read_multicol_pose(root, i + 1);
    rig.cameras.push_back(std::move(camera));
  }
  return rig;
}

}  // namespace raysfm
