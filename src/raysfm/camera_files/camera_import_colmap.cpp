#include <fmt/format.h>

#include <cmath>
#include <map>

#include "raysfm/camera_files/camera_import.h"
#include "raysfm/camera_files/camera_lines.h"
#include "raysfm/camera_files/colmap_camera.h"

namespace raysfm {
namespace {

constexpr uintmax_t kMaxColmapBytes = 16u << 20;
constexpr int64_t kMaxId = 0xffffffff;

void read_camera_line(const TextLine& line, Camera* camera, ConfigProblem* problem, std::string* note) {
  const std::string field = fmt::format("line {}", line.number);
  const std::vector<std::string_view> words = split_words(line.text);
  if (words.size() < 5 || !parse_integer(words[0])) {
    return problem->report(field, "'" + shown(line.text) + "'", "CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]");
  }
  const ColmapCameraModel* model = find_colmap_model(words[1]);
  if (!model) return problem->report(field + ": MODEL", "'" + shown(words[1]) + "'", colmap_model_names());
  const ConfigField params(nullptr, field + ": PARAMS", problem);
  const std::vector<double> p = finite_numbers(words, 4, words.size(), params.name(), problem);
  if (p.size() != model->parameters) {
    return problem->report(params.name(), fmt::format("{} numbers", p.size()),
                           fmt::format("{} for {}", model->parameters, model->name));
  }
  camera->name = fmt::format("camera{}", words[0]);
  camera->width = static_cast<int>(integer_word(words[2], 1, kMaxImageSide, field + ": WIDTH", problem));
  camera->height = static_cast<int>(integer_word(words[3], 1, kMaxImageSide, field + ": HEIGHT", problem));
  if (problem->any()) return;
  if (model->name == "FOV") {
    camera->model =
        fov_model({p[0], p[1], p[2] - 0.5, p[3] - 0.5, p[4]}, camera->width, camera->height, params, note);
  } else {
    const Result<CameraModel> known = camera_model_from_colmap(model->id, p);
    if (!known) return problem->report(params.name(), known.error().message, "another camera");
    camera->model = *known;
  }
  if (!problem->any()) check_intrinsics(camera->model, params);
}

// The cameras of cameras.txt by their CAMERA_ID.
std::map<int64_t, Camera> read_cameras(std::string_view text, ConfigProblem* problem, std::string* note) {
  std::map<int64_t, Camera> cameras;
  for (const TextLine& line : content_lines(text)) {
    Camera camera;
    read_camera_line(line, &camera, problem, note);
    if (problem->any()) return {};
    const int64_t id = *parse_integer(split_words(line.text).front());
    if (!cameras.emplace(id, std::move(camera)).second) {
      problem->report(fmt::format("line {}", line.number), fmt::format("CAMERA_ID {} again", id),
                      "each id once");
    }
  }
  return cameras;
}

// sensor_from_rig from QW QX QY QZ TX TY TZ.
Rigid3 read_pose(const std::vector<double>& p, const std::string& field, ConfigProblem* problem) {
  const Eigen::Quaterniond q(p[0], p[1], p[2], p[3]);
  if (!(std::abs(q.norm() - 1) < 1e-3)) {
    problem->report(field, fmt::format("a quaternion of length {:.6g}", q.norm()), "QW QX QY QZ of length 1");
    return {};
  }
  return {q.normalized(), Eigen::Vector3d(p[4], p[5], p[6])};
}

struct Sensor {
  int64_t camera_id;
  Rigid3 rig_from_sensor;
};

// RIG_ID NUM_SENSORS REF_SENSOR_TYPE REF_SENSOR_ID (SENSOR_TYPE SENSOR_ID HAS_POSE [7 numbers])*; sensors
// that are no cameras are skipped.
std::vector<Sensor> read_rig_line(const TextLine& line, ConfigProblem* problem) {
  const std::string field = fmt::format("line {}", line.number);
  const std::vector<std::string_view> words = split_words(line.text);
  std::vector<Sensor> sensors;
  if (words.size() < 4) {
    problem->report(field, "'" + shown(line.text) + "'",
                    "RIG_ID NUM_SENSORS REF_SENSOR_TYPE REF_SENSOR_ID ...");
    return sensors;
  }
  const int64_t count = integer_word(words[1], 1, 1024, field + ": NUM_SENSORS", problem);
  size_t at = 2;
  for (int64_t i = 0; i < count && !problem->any(); ++i) {
    const bool reference = i == 0;
    if (at + (reference ? 2 : 3) > words.size()) {
      problem->report(field, fmt::format("{} sensors", i), fmt::format("NUM_SENSORS, {}", count));
      return sensors;
    }
    const bool camera = words[at] == "CAMERA";
    const int64_t id = integer_word(words[at + 1], 0, kMaxId, field + ": SENSOR_ID", problem);
    at += 2;
    Rigid3 rig_from_sensor;
    if (!reference && integer_word(words[at++], 0, 1, field + ": HAS_POSE", problem) == 1) {
      if (at + 7 > words.size()) {
        problem->report(field, "a pose cut short", "QW QX QY QZ TX TY TZ");
        return sensors;
      }
      rig_from_sensor =
          read_pose(finite_numbers(words, at, at + 7, field, problem), field, problem).inverse();
      at += 7;
    } else if (!reference && camera) {
      problem->report(field, fmt::format("camera {} without a pose", id), "HAS_POSE of 1 and a pose");
    }
    if (camera) sensors.push_back({id, rig_from_sensor});
  }
  return sensors;
}

}  // namespace

Rig import_colmap(std::string_view text, ConfigProblem* problem, std::string* note) {
  const std::vector<TextLine> lines = content_lines(text);
  if (lines.size() != 1) {
    problem->report("cameras", fmt::format("{} of them", lines.size()),
                    "one, as cameras.txt does not say how several stand to each other; rigs.txt does");
    return {};
  }
  Camera camera;
  read_camera_line(lines.front(), &camera, problem, note);
  return Rig{{std::move(camera)}};
}

Rig import_colmap_rig(std::string_view text, const std::filesystem::path& path, ConfigProblem* problem,
                      std::string* note) {
  const std::vector<TextLine> lines = content_lines(text);
  if (lines.size() != 1) {
    problem->report("rigs", fmt::format("{} of them", lines.size()), "one");
    return {};
  }
  const std::filesystem::path cameras_path = path.parent_path() / "cameras.txt";
  const Result<std::string> cameras_text = read_text_file(cameras_path, kMaxColmapBytes);
  ConfigProblem in_cameras(cameras_path.string());
  std::map<int64_t, Camera> cameras;
  if (cameras_text) cameras = read_cameras(*cameras_text, &in_cameras, note);
  if (!cameras_text || in_cameras.any()) {
    problem->report("cameras.txt", cameras_text ? in_cameras.error().message : cameras_text.error().message,
                    "COLMAP's cameras.txt in the same folder");
    return {};
  }
  Rig rig;
  for (const Sensor& sensor : read_rig_line(lines.front(), problem)) {
    const auto found = cameras.find(sensor.camera_id);
    if (found == cameras.end()) {
      problem->report("SENSOR_ID", fmt::format("{}", sensor.camera_id), "a camera of cameras.txt");
      return {};
    }
    Camera camera = found->second;
    camera.rig_from_cam = sensor.rig_from_sensor;
    camera.stream = static_cast<int>(rig.cameras.size());
    rig.cameras.push_back(std::move(camera));
  }
  return rig;
}

}  // namespace raysfm
