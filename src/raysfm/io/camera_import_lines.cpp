#include <fmt/format.h>

#include <cmath>

#include "raysfm/io/camera_import.h"
#include "raysfm/io/text_file.h"

namespace raysfm {
namespace {

// The words from `first` on as finite numbers; reports the first that is none.
std::vector<double> finite_numbers(const std::vector<std::string_view>& words, size_t first,
                                   const std::string& field, ConfigProblem* problem) {
  std::vector<double> values;
  for (size_t i = first; i < words.size(); ++i) {
    const std::optional<double> value = parse_number(words[i]);
    if (!value || !std::isfinite(*value))
      problem->report(field, "'" + shown(words[i]) + "'", "finite numbers");
    values.push_back(value.value_or(0));
  }
  return values;
}

// A COLMAP model: how its parameters become fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6.
struct ColmapModel {
  std::string_view name;
  size_t parameters;
  bool one_focal_length;
};
constexpr ColmapModel kColmapModels[] = {{"SIMPLE_PINHOLE", 3, true}, {"PINHOLE", 4, false},
                                         {"SIMPLE_RADIAL", 4, true},  {"RADIAL", 5, true},
                                         {"OPENCV", 8, false},        {"FULL_OPENCV", 12, false}};

int read_side(std::string_view word, const std::string& field, ConfigProblem* problem) {
  const std::optional<int64_t> side = parse_integer(word);
  if (side && *side >= 1 && *side <= kMaxImageSide) return static_cast<int>(*side);
  problem->report(field, "'" + shown(word) + "'", fmt::format("an integer from 1 to {}", kMaxImageSide));
  return 1;
}

void read_colmap_line(const TextLine& line, Camera* camera, ConfigProblem* problem) {
  const std::string field = fmt::format("line {}", line.number);
  const std::vector<std::string_view> words = split_words(line.text);
  if (words.size() < 5 || !parse_integer(words[0])) {
    return problem->report(field, "'" + shown(line.text) + "'", "CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]");
  }
  const ColmapModel* model = nullptr;
  std::string names;
  for (const ColmapModel& known : kColmapModels) {
    if (known.name == words[1]) model = &known;
    names += (names.empty() ? "" : ", ") + std::string(known.name);
  }
  if (!model) return problem->report(field + ": MODEL", "'" + shown(words[1]) + "'", names);
  std::vector<double> p = finite_numbers(words, 4, field + ": PARAMS", problem);
  if (p.size() != model->parameters) {
    return problem->report(field + ": PARAMS", fmt::format("{} numbers", p.size()),
                           fmt::format("{} for {}", model->parameters, model->name));
  }
  if (model->one_focal_length) p.insert(p.begin(), p.front());
  p[2] -= 0.5;
  p[3] -= 0.5;
  camera->name = fmt::format("camera{}", words[0]);
  camera->width = read_side(words[2], field + ": WIDTH", problem);
  camera->height = read_side(words[3], field + ": HEIGHT", problem);
  camera->model = perspective_model(p);
  check_intrinsics(camera->model, ConfigField(nullptr, field + ": PARAMS", problem));
}

}  // namespace

Rig import_kitti(std::string_view text, ConfigProblem* problem) {
  Rig rig;
  for (const TextLine& line : content_lines(text)) {
    const std::vector<std::string_view> words = split_words(line.text);
    const std::string_view key = words.front();
    if (key.size() != 3 || key[0] != 'P' || key[1] < '0' || key[1] > '3' || key[2] != ':') continue;
    const std::string field = fmt::format("line {}: {}", line.number, key.substr(0, 2));
    const std::vector<double> p = finite_numbers(words, 1, field, problem);
    const bool shape = p.size() == 12 && p[1] == 0 && p[4] == 0 && p[8] == 0 && p[9] == 0 && p[10] == 1;
    if (!shape || !(p[0] > 0) || !(p[5] > 0)) {
      problem->report(field, shape ? fmt::format("focal lengths {}, {}", p[0], p[5]) : "no such matrix",
                      "12 numbers by rows: fx 0 cx a, 0 fy cy b, 0 0 1 c, with fx, fy above 0");
      return rig;
    }
    Camera camera;
    camera.stream = key[1] - '0';
    camera.name = fmt::format("image_{}", camera.stream);
    for (const Camera& other : rig.cameras) {
      if (other.name == camera.name) problem->report(field, "a second time", "each of P0 to P3 once");
    }
    camera.model = Pinhole{p[0], p[5], p[2], p[6]};
    check_intrinsics(camera.model, ConfigField(nullptr, field, problem));
    camera.rig_from_cam.translation =
        -Eigen::Vector3d((p[3] - p[2] * p[11]) / p[0], (p[7] - p[6] * p[11]) / p[5], p[11]);
    rig.cameras.push_back(std::move(camera));
  }
  return rig;
}

Rig import_colmap(std::string_view text, ConfigProblem* problem) {
  const std::vector<TextLine> lines = content_lines(text);
  if (lines.size() != 1) {
    problem->report("cameras", fmt::format("{} of them", lines.size()),
                    "one, as cameras.txt does not say how several stand to each other");
    return {};
  }
  Camera camera;
  read_colmap_line(lines.front(), &camera, problem);
  return Rig{{std::move(camera)}};
}

}  // namespace raysfm
