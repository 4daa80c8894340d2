#include <fmt/format.h>

#include "raysfm/camera_files/camera_import.h"
#include "raysfm/camera_files/camera_lines.h"

namespace raysfm {

Rig import_kitti(std::string_view text, ConfigProblem* problem) {
  Rig rig;
  for (const TextLine& line : content_lines(text)) {
    const std::vector<std::string_view> words = split_words(line.text);
    const std::string_view key = words.front();
    if (key.size() != 3 || key[0] != 'P' || key[1] < '0' || key[1] > '3' || key[2] != ':') continue;
    const std::string field = fmt::format("line {}: {}", line.number, key.substr(0, 2));
    const std::vector<double> p = finite_numbers(words, 1, words.size(), field, problem);
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

}  // namespace raysfm
