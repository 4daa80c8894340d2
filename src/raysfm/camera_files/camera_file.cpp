#include "raysfm/camera_files/camera_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>

#include "raysfm/camera_files/camera_import.h"
#include "raysfm/camera_files/camera_yaml.h"
#include "raysfm/files/text_file.h"

namespace raysfm {
namespace {

constexpr uintmax_t kMaxCameraBytes = 16u << 20;

bool looks_like_kitti(std::string_view line) {
  return line.size() > 3 && line[0] == 'P' && line[1] >= '0' && line[1] <= '3' && line[2] == ':';
}

// "1 PINHOLE 640 480 ...": an identifier, a name in capitals, two more words.
bool looks_like_colmap(std::string_view line) {
  const std::vector<std::string_view> words = split_words(line.substr(0, 200));
  if (words.size() < 4 || !parse_integer(words[0]) || !parse_integer(words[2])) return false;
  return std::all_of(words[1].begin(), words[1].end(),
                     [](char c) { return (c >= 'A' && c <= 'Z') || c == '_'; });
}

// "1 2 CAMERA 1 ...": a line of COLMAP's rigs.txt.
bool looks_like_colmap_rig(std::string_view line) {
  const std::vector<std::string_view> words = split_words(line.substr(0, 200));
  return words.size() >= 4 && parse_integer(words[0]) && parse_integer(words[1]) &&
         (words[2] == "CAMERA" || words[2] == "IMU");
}

// OCamCalib's first line of numbers: N and N coefficients.
bool looks_like_ocamcalib(std::string_view line) {
  const std::vector<std::string_view> words = split_words(line.substr(0, 1000));
  const std::optional<int64_t> count = parse_integer(words.front());
  return words.size() >= 2 && count && *count == static_cast<int64_t>(words.size()) - 1 &&
         std::all_of(words.begin(), words.end(), [](std::string_view word) { return parse_number(word); });
}

bool looks_like_opencv(const ConfigField& root) {
  constexpr std::string_view kMatrices[] = {
      "camera_matrix", "cameraMatrix",    "Camera_Matrix",     "K", "M", "M1", "K1",
      "cameraMatrix1", "camera_matrix_1", "left_camera_matrix"};
  return std::any_of(std::begin(kMatrices), std::end(kMatrices),
                     [&](std::string_view key) { return root.at(key).exists(); });
}

bool looks_like_omnimvs(const ConfigField& root) {
  const ConfigField cameras = root.at("cameras");
  if (!cameras.is_list() || root.at("raysfm_camera").exists()) return false;
  const std::vector<ConfigField> list = cameras.list();
  return !list.empty() && list.front().at("poly").exists();
}

Rig read_document(const ConfigField& root, const std::filesystem::path& path, std::string* note) {
  if (looks_like_omnimvs(root)) return import_omnimvs(root, note);
  if (root.at("raysfm_camera").exists()) return read_camera_yaml(root);
  if (root.at("cam0").is_map()) return import_kalibr(root, note);
  if (root.at("T_BS").exists() || (root.at("sensor_type").exists() && root.at("intrinsics").exists())) {
    return import_euroc(root, note);
  }
  if (root.at("value0").exists()) return import_basalt(root, note);
  if (root.at("CameraSystem.nrCams").exists()) return import_multicol_rig(root, path);
  if (root.at("Camera.nrpol").exists()) return import_multicol(root);
  if (root.at("Camera").at("model").exists() || root.at("Camera.model").exists()) {
    return import_stella(root, note);
  }
  if (root.at("Camera.fx").exists() || root.at("Camera1.fx").exists() || root.at("Camera.type").exists()) {
    return import_orbslam(root, note);
  }
  if (root.at("type").exists() && root.at("grid_width").exists()) return import_generic(root);
  if (looks_like_opencv(root)) return import_opencv(root, note);
  root.problem().report("raysfm_camera", "missing",
                        "1, or a camera file of Kalibr, OpenCV, COLMAP, KITTI, EuRoC, OCamCalib, MultiCol, "
                        "basalt, stella_vslam, ORB-SLAM or of generic models");
  return {};
}

// Whether the model's distortion is a polynomial, which may turn back inside the image.
bool has_polynomial(const CameraModel& model) {
  return std::holds_alternative<Radtan>(model) || std::holds_alternative<Rational>(model) ||
         std::holds_alternative<KannalaBrandt>(model) || std::holds_alternative<Unified>(model) ||
         std::holds_alternative<OCam>(model);
}

// Share of the pixels that have a ray.
double seeing_share(const Camera& camera) {
  constexpr int kGrid = 16;
  int seeing = 0;
  for (int i = 0; i < kGrid * kGrid; ++i) {
    const Eigen::Vector2d pixel((i % kGrid + 0.5) / kGrid * camera.width - 0.5,
                                (i / kGrid + 0.5) / kGrid * camera.height - 0.5);
    Ray ray;
    seeing += camera.ray(pixel, &ray);
  }
  return static_cast<double>(seeing) / (kGrid * kGrid);
}

// What holds for a rig from any format.
void check_rig(const Rig& rig, ConfigProblem* problem) {
  if (rig.cameras.empty()) problem->report("cameras", "none", "at least one");
  for (const Camera& camera : rig.cameras) {
    const Eigen::Vector3d& t = camera.rig_from_cam.translation;
    if (!t.allFinite() || t.norm() > 1e9)
      problem->report(camera.name, "translation of its pose", "numbers up to 1e9");
    if (problem->any() || camera.width == 0) continue;
    if (!(camera.pixels_per_radian() > 0)) {
      problem->report(camera.name, "intrinsics", "a camera at least one pixel of whose image has a ray");
    }
    constexpr double kLeastShare = 0.1;
    const double share = has_polynomial(camera.model) ? seeing_share(camera) : 1;
    if (!problem->any() && share < kLeastShare) {
      problem->report(
          camera.name + ".intrinsics",
          fmt::format("a distortion that stops rising with {:.1f} % of the image seen", 100 * share),
          fmt::format("one that rises over at least {:.0f} % of it", 100 * kLeastShare));
    }
  }
}

}  // namespace

Result<Rig> parse_camera_file(std::string_view text, const std::filesystem::path& path, std::string* note) {
  std::string said;
  ConfigProblem problem(path.string());
  const std::vector<TextLine> head = content_lines(text.substr(0, 4096));
  Rig rig;
  if (head.empty()) return bad_input(path.string() + ": empty; allowed: a camera file");
  const std::string_view first = head.front().text;
  if (looks_like_kitti(first)) {
    rig = import_kitti(text, &problem);
  } else if (looks_like_colmap(first)) {
    rig = import_colmap(text, &problem, &said);
  } else if (looks_like_colmap_rig(first)) {
    rig = import_colmap_rig(text, path, &problem, &said);
  } else if (looks_like_ocamcalib(first)) {
    rig = import_ocamcalib(text, &problem);
  } else {
    const bool xml = first.starts_with('<');
    const Result<ConfigNode> tree = xml ? parse_xml(text, path.string()) : parse_yaml(text, path.string());
    if (!tree) return tree.error();
    rig = read_document(ConfigField(&*tree, "", &problem), path, &said);
  }
  if (!problem.any()) check_rig(rig, &problem);
  if (problem.any()) return problem.error();
  for (Camera& camera : rig.cameras) {
    if (!camera.mask_path.empty()) camera.mask_path = (path.parent_path() / camera.mask_path).string();
  }
  if (note) *note = said;
  return rig;
}

Result<Rig> read_camera_file(const std::filesystem::path& path, std::string* note) {
  const Result<std::string> text = read_text_file(path, kMaxCameraBytes);
  if (!text) return text.error();
  Result<Rig> rig = parse_camera_file(*text, path, note);
  if (!rig) return rig;
  for (const Camera& camera : rig->cameras) {
    std::error_code failure;
    if (camera.mask_path.empty() || std::filesystem::is_regular_file(camera.mask_path, failure)) continue;
    return bad_input(fmt::format("{}: {}.mask: '{}'; allowed: an image file", path.string(), camera.name,
                                 camera.mask_path));
  }
  return rig;
}

}  // namespace raysfm
