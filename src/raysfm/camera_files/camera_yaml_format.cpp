#include <fmt/format.h>

#include "raysfm/camera_files/camera_file.h"
#include "raysfm/camera_files/camera_table.h"
#include "raysfm/camera_files/camera_yaml.h"
#include "raysfm/files/atomic_file.h"

namespace raysfm {
namespace {

// A YAML string in double quotes.
std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') {
      out += {'\\', c};
    } else if (static_cast<unsigned char>(c) < ' ' || c == 127) {
      out += fmt::format("\\x{:02x}", static_cast<unsigned char>(c));
    } else {
      out += c;
    }
  }
  return out + "\"";
}

// The maps of a model's numbers, one line each, from its names such as "fx" and "mirror.apex[0]".
class ParameterLines {
 public:
  void add(std::string_view name, double value) {
    std::string map = "intrinsics", list;
    if (const size_t dot = name.find('.'); dot != std::string_view::npos) {
      map = name.substr(0, dot);
      name.remove_prefix(dot + 1);
    }
    if (const size_t bracket = name.find('['); bracket != std::string_view::npos) {
      list = name = name.substr(0, bracket);
    }
    const bool goes_on = map == map_ && !list.empty() && list == list_;
    if (!goes_on && !list_.empty()) text_ += "]";
    if (map != map_) text_ += fmt::format("{}    {}: {{", map_.empty() ? "" : "}\n", map);
    if (map == map_) text_ += ", ";
    if (!goes_on) text_ += fmt::format("{}: {}", name, list.empty() ? "" : "[");
    text_ += fmt::format("{}", value);
    map_ = map;
    list_ = list;
  }
  std::string text() const { return text_ + (list_.empty() ? "}\n" : "]}\n"); }

 private:
  std::string text_, map_, list_;
};

// Zeros at the end are left out where the model does not require them.
template <ParametricModel Model>
std::string format_parameters(const Model& model) {
  const auto numbers = model.parameters(), defaults = Model{}.parameters();
  size_t count = numbers.size();
  while (count > Model::kRequired && numbers[count - 1] == 0 && defaults[count - 1] == 0) --count;
  ParameterLines lines;
  // A model that requires nothing has other defaults for other images: it is written whole.
  for (size_t i = 0; i < count; ++i) lines.add(Model::kParameterNames[i], numbers[i]);
  return lines.text();
}

std::string format_model(const CameraModel& model) {
  return std::visit(
      []<typename Model>(const Model& m) -> std::string {
        if constexpr (ParametricModel<Model>) {
          return format_parameters(m);
        } else {
          return m.data() ? format_table(*m.data()) : std::string();
        }
      },
      model);
}

std::string format_camera(const Camera& camera) {
  const Eigen::Quaterniond& q = camera.rig_from_cam.rotation;
  const Eigen::Vector3d& t = camera.rig_from_cam.translation;
  std::string text = fmt::format(
      "  - name: {}\n    model: {}\n    resolution: [{}, {}]\n{}"
      "    rig_from_cam: {{rotation: [{}, {}, {}, {}], translation: [{}, {}, {}]}}\n    stream: {}\n",
      quoted(camera.name), model_name(camera.model), camera.width, camera.height, format_model(camera.model),
      q.x(), q.y(), q.z(), q.w(), t.x(), t.y(), t.z(), camera.stream);
  if (camera.roi.w > 0) {
    const Roi& roi = camera.roi;
    text += fmt::format("    roi: [{}, {}, {}, {}]\n", roi.x, roi.y, roi.w, roi.h);
  }
  if (camera.shutter.readout > 0) {
    text +=
        fmt::format("    rolling_shutter: {{readout_ms: {}, direction: {}}}\n", 1000 * camera.shutter.readout,
                    kShutterDirections[static_cast<int>(camera.shutter.direction)]);
  }
  if (!camera.mask_path.empty()) text += fmt::format("    mask: {}\n", quoted(camera.mask_path));
  return text;
}

}  // namespace

std::string format_camera_file(const Rig& rig) {
  std::string text = "raysfm_camera: 1\ncameras:\n";
  for (const Camera& camera : rig.cameras) text += format_camera(camera);
  return text;
}

Result<void> write_camera_file(const Rig& rig, const std::filesystem::path& path) {
  return write_file(path, format_camera_file(rig));
}

}  // namespace raysfm
