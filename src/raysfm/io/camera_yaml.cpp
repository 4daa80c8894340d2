#include "raysfm/io/camera_yaml.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "raysfm/io/atomic_file.h"
#include "raysfm/io/camera_file.h"
#include "raysfm/io/camera_import.h"
#include "raysfm/io/text_file.h"

namespace raysfm {
namespace {

constexpr int kMaxCameras = 1024;

// Calls visit(Model{}) for each model of the variant.
template <typename Visit, size_t... I>
void for_each_model(Visit visit, std::index_sequence<I...>) {
  (visit(std::variant_alternative_t<I, CameraModel>{}), ...);
}
template <typename Visit>
void for_each_model(Visit visit) {
  for_each_model(visit, std::make_index_sequence<std::variant_size_v<CameraModel>>{});
}

template <ParametricModel Model>
Model read_intrinsics(const ConfigField& field) {
  field.allow_only({Model::kParameterNames.begin(), Model::kParameterNames.end()});
  auto numbers = Model{}.parameters();
  for (size_t i = 0; i < numbers.size(); ++i) {
    const ConfigField number = field.at(Model::kParameterNames[i]);
    if (number.exists() || i < Model::kRequired) numbers[i] = number.number();
  }
  if (field.problem().any()) return Model{};
  return Model::from_parameters(numbers);
}

CameraModel read_model(const ConfigField& camera) {
  const std::string name = camera.at("model").text();
  CameraModel model;
  bool known = false;
  for_each_model([&](auto candidate) {
    using Model = decltype(candidate);
    if (known || Model::kName != name) return;
    known = true;
    if constexpr (ParametricModel<Model>) model = read_intrinsics<Model>(camera.at("intrinsics"));
    check_intrinsics(model, camera.at("intrinsics"));
  });
  if (!known) camera.at("model").report(supported_models());
  return model;
}

Rigid3 read_rig_from_cam(const ConfigField& field) {
  Rigid3 rig_from_cam;
  if (!field.exists()) return rig_from_cam;
  field.allow_only({"rotation", "translation"});
  const std::vector<double> q = field.at("rotation").numbers(4);
  const std::vector<double> t = field.at("translation").numbers(3);
  const Eigen::Quaterniond rotation(q[3], q[0], q[1], q[2]);
  if (!(std::abs(rotation.norm() - 1) < 1e-3)) {
    field.problem().report(field.at("rotation").name(),
                           fmt::format("a quaternion of length {:.6g}", rotation.norm()),
                           "[qx, qy, qz, qw] of length 1");
    return rig_from_cam;
  }
  return {rotation.normalized(), Eigen::Vector3d(t[0], t[1], t[2])};
}

void read_image_part(const ConfigField& field, Camera* camera) {
  const std::vector<ConfigField> resolution = field.at("resolution").list();
  if (resolution.size() != 2) return field.at("resolution").report("[width, height]");
  camera->width = resolution[0].integer(1, kMaxImageSide);
  camera->height = resolution[1].integer(1, kMaxImageSide);
  if (!field.at("roi").exists()) return;
  const std::vector<ConfigField> roi = field.at("roi").list();
  if (roi.size() != 4) return field.at("roi").report("[x, y, width, height]");
  camera->roi = {roi[0].integer(0, kMaxImageSide), roi[1].integer(0, kMaxImageSide),
                 roi[2].integer(1, kMaxImageSide), roi[3].integer(1, kMaxImageSide)};
  if (camera->roi.w != camera->width || camera->roi.h != camera->height) {
    field.problem().report(field.at("roi").name(), fmt::format("{} x {}", camera->roi.w, camera->roi.h),
                           fmt::format("the camera's resolution, {} x {}", camera->width, camera->height));
  }
}

Camera read_camera(const ConfigField& field) {
  Camera camera;
  camera.name = field.at("name").text();
  if (camera.name.empty()) field.at("name").report("a name");
  camera.model = read_model(field);  // first, as other models have other fields
  field.allow_only({"name", "model", "resolution", "intrinsics", "rig_from_cam", "stream", "roi", "mask"});
  read_image_part(field, &camera);
  camera.rig_from_cam = read_rig_from_cam(field.at("rig_from_cam"));
  if (field.at("stream").exists()) camera.stream = field.at("stream").integer(0, kMaxCameras - 1);
  if (field.at("mask").exists()) {
    camera.mask_path = field.at("mask").text();
    if (camera.mask_path.empty()) field.at("mask").report("the path of an image");
  }
  return camera;
}

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

std::string format_camera(const Camera& camera) {
  std::string intrinsics;
  std::visit(
      [&](const auto& model) {
        if constexpr (ParametricModel<std::decay_t<decltype(model)>>) {
          const auto numbers = model.parameters();
          for (size_t i = 0; i < numbers.size(); ++i) {
            intrinsics += fmt::format("{}{}: {}", i ? ", " : "", model.kParameterNames[i], numbers[i]);
          }
        }
      },
      camera.model);
  const Eigen::Quaterniond& q = camera.rig_from_cam.rotation;
  const Eigen::Vector3d& t = camera.rig_from_cam.translation;
  std::string text = fmt::format(
      "  - name: {}\n    model: {}\n    resolution: [{}, {}]\n    intrinsics: {{{}}}\n"
      "    rig_from_cam: {{rotation: [{}, {}, {}, {}], translation: [{}, {}, {}]}}\n    stream: {}\n",
      quoted(camera.name), model_name(camera.model), camera.width, camera.height, intrinsics, q.x(), q.y(),
      q.z(), q.w(), t.x(), t.y(), t.z(), camera.stream);
  if (camera.roi.w > 0) {
    const Roi& roi = camera.roi;
    text += fmt::format("    roi: [{}, {}, {}, {}]\n", roi.x, roi.y, roi.w, roi.h);
  }
  if (!camera.mask_path.empty()) text += fmt::format("    mask: {}\n", quoted(camera.mask_path));
  return text;
}

}  // namespace

Rig read_camera_yaml(const ConfigField& root) {
  root.allow_only({"raysfm_camera", "cameras"});
  root.at("raysfm_camera").integer(1, 1);
  const std::vector<ConfigField> fields = root.at("cameras").list();
  if (fields.empty() || fields.size() > kMaxCameras) {
    root.at("cameras").report(fmt::format("a list of 1 to {} cameras", kMaxCameras));
    return {};
  }
  Rig rig;
  for (const ConfigField& field : fields) {
    rig.cameras.push_back(read_camera(field));
    for (size_t i = 0; i + 1 < rig.cameras.size(); ++i) {
      if (rig.cameras[i].name == rig.cameras.back().name)
        field.at("name").report("a name that no other camera has");
    }
    if (root.problem().any()) return {};
  }
  return rig;
}

std::string supported_models() {
  std::string names;
  for_each_model([&](auto model) { names += (names.empty() ? "" : ", ") + std::string(model.kName); });
  return names;
}

CameraModel perspective_model(const std::vector<double>& numbers) {
  std::array<double, 12> p{};
  std::copy_n(numbers.begin(), std::min(numbers.size(), p.size()), p.begin());
  const auto zero_from = [&](size_t first) {
    return std::all_of(p.begin() + first, p.end(), [](double v) { return v == 0; });
  };
  if (zero_from(4)) return Pinhole{p[0], p[1], p[2], p[3]};
  if (zero_from(9)) return Radtan{p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8]};
  return Rational::from_parameters(p);
}

void check_intrinsics(const CameraModel& model, const ConfigField& field) {
  constexpr double kLargest = 1e6;
  std::visit(
      [&](const auto& m) {
        if constexpr (ParametricModel<std::decay_t<decltype(m)>>) {
          const auto numbers = m.parameters();
          for (size_t i = 0; i < numbers.size(); ++i) {
            const std::string_view name = m.kParameterNames[i];
            const bool focal = name.starts_with('f');
            const bool centre = name.starts_with('c');
            const bool allowed = std::isfinite(numbers[i]) && (!focal || numbers[i] > 0) &&
                                 (!(focal || centre) || std::abs(numbers[i]) <= kLargest);
            if (allowed) continue;
            field.problem().report(fmt::format("{}.{}", field.name(), name), fmt::format("{}", numbers[i]),
                                   focal ? "above 0, at most 1e6" : "between -1e6 and 1e6");
          }
        }
      },
      model);
}

std::string format_camera_file(const Rig& rig) {
  std::string text = "raysfm_camera: 1\ncameras:\n";
  for (const Camera& camera : rig.cameras) text += format_camera(camera);
  return text;
}

Result<void> write_camera_file(const Rig& rig, const std::filesystem::path& path) {
  return write_file(path, format_camera_file(rig));
}

}  // namespace raysfm
