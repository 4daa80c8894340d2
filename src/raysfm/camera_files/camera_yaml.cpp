#include "raysfm/camera_files/camera_yaml.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

#include "raysfm/camera/model_check.h"
#include "raysfm/camera_files/camera_import.h"
#include "raysfm/camera_files/camera_table.h"

namespace raysfm {
namespace {

constexpr int kMaxRigCameras = 1024;

// Calls visit(Model{}) for each model of the variant.
template <typename Visit, size_t... I>
void for_each_model(Visit visit, std::index_sequence<I...>) {
  (visit(std::variant_alternative_t<I, CameraModel>{}), ...);
}
template <typename Visit>
void for_each_model(Visit visit) {
  for_each_model(visit, std::make_index_sequence<std::variant_size_v<CameraModel>>{});
}

// A name of kParameterNames taken apart: "mirror.apex[1]" is element 1 of `apex` in the map `mirror`.
struct ParameterPlace {
  std::string map = "intrinsics";
  std::string key;
  int element = -1;  // -1: no list
};

ParameterPlace place_of(std::string_view name) {
  ParameterPlace place;
  if (const size_t dot = name.find('.'); dot != std::string_view::npos) {
    place.map = name.substr(0, dot);
    name.remove_prefix(dot + 1);
  }
  if (const size_t bracket = name.find('['); bracket != std::string_view::npos) {
    place.element = name[bracket + 1] - '0';
    name = name.substr(0, bracket);
  }
  place.key = name;
  return place;
}

using ParameterPlaces = std::vector<ParameterPlace>;

template <ParametricModel Model>
ParameterPlaces places_of() {
  ParameterPlaces places;
  for (std::string_view name : Model::kParameterNames) places.push_back(place_of(name));
  return places;
}

// Reports fields that the model does not have in the maps that it has.
void refuse_unknown_fields(const ConfigField& camera, const ParameterPlaces& places) {
  for (const ParameterPlace& place : places) {
    if (!camera.at(place.map).exists()) continue;
    std::vector<std::string_view> known;
    for (const ParameterPlace& other : places) {
      if (other.map == place.map && (known.empty() || known.back() != other.key)) known.push_back(other.key);
    }
    camera.at(place.map).allow_only(known);
  }
}

// A number that stands alone, or in a list together with the others of the same key.
double read_number(const ConfigField& field, const ParameterPlaces& places, const ParameterPlace& place) {
  if (place.element < 0) return field.number();
  const auto same = [&](const ParameterPlace& other) {
    return other.map == place.map && other.key == place.key;
  };
  return field.numbers(std::ranges::count_if(places, same))[place.element];
}

template <ParametricModel Model>
Model read_parameters(const ConfigField& camera, int width, int height) {
  auto numbers = default_model<Model>(width, height).parameters();
  const ParameterPlaces places = places_of<Model>();
  refuse_unknown_fields(camera, places);
  for (size_t i = 0; i < numbers.size(); ++i) {
    const ConfigField field = camera.at(places[i].map).at(places[i].key);
    if (field.exists() || i < Model::kRequired) numbers[i] = read_number(field, places, places[i]);
  }
  if (camera.problem().any()) return Model{};
  return Model::from_parameters(numbers);
}

template <typename Model>
void read_if_named(const std::string& name, const ConfigField& camera, int width, int height,
                   std::optional<CameraModel>* model) {
  if (Model::kName != name || *model) return;
  if constexpr (ParametricModel<Model>) {
    *model = read_parameters<Model>(camera, width, height);
  } else {
    *model = read_table(camera.at("table"));
  }
}

// The name of a model that there is; reports others.
std::string read_model_name(const ConfigField& field) {
  const std::string name = field.text();
  bool known = false;
  for_each_model([&](auto model) { known |= model.kName == name; });
  if (!known) field.report(supported_models());
  return name;
}

CameraModel read_model(const ConfigField& camera, const std::string& name, int width, int height) {
  std::optional<CameraModel> model;
  for_each_model(
      [&](auto candidate) { read_if_named<decltype(candidate)>(name, camera, width, height, &model); });
  if (!model) return Pinhole{};
  const std::optional<ParameterProblem> problem = find_problem(*model);
  if (problem && !camera.problem().any()) {
    const ParameterPlace place = place_of(problem->name);
    camera.problem().report(camera.at(place.map).at(place.key).name(), fmt::format("{}", problem->value),
                            std::string(problem->allowed));
  }
  return *model;
}

// All fields that a camera with this model may have.
std::vector<std::string_view> camera_fields(const std::string& model) {
  std::vector<std::string_view> known = {"name",   "model", "resolution", "intrinsics",     "rig_from_cam",
                                         "stream", "roi",   "mask",       "rolling_shutter"};
  if (model == CentralRayTable::kName) std::ranges::replace(known, "intrinsics", "table");
  if (model == Mirror::kName) known.push_back("mirror");
  return known;
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
  read_resolution(field.at("resolution"), camera);
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

RollingShutter read_shutter(const ConfigField& field) {
  constexpr double kMostMs = 1000;
  RollingShutter shutter;
  if (!field.exists()) return shutter;
  field.allow_only({"readout_ms", "direction"});
  const double ms = field.at("readout_ms").number();
  if (!(ms >= 0 && ms <= kMostMs)) {
    field.problem().report(field.at("readout_ms").name(), fmt::format("{}", ms),
                           fmt::format("0 to {}", kMostMs));
  }
  shutter.readout = ms / 1000;
  if (!field.at("direction").exists()) return shutter;
  const std::string name = field.at("direction").text();
  const auto found = std::ranges::find(kShutterDirections, name);
  if (found == std::end(kShutterDirections)) {
    field.at("direction").report("down, up, right or left");
    return shutter;
  }
  shutter.direction = static_cast<RollingShutter::Direction>(found - std::begin(kShutterDirections));
  return shutter;
}

Camera read_camera(const ConfigField& field) {
  Camera camera;
  camera.name = field.at("name").text();
  if (camera.name.empty()) field.at("name").report("a name");
  const std::string model = read_model_name(field.at("model"));
  read_image_part(field, &camera);
  camera.model = read_model(field, model, camera.width, camera.height);
  field.allow_only(camera_fields(model));
  camera.rig_from_cam = read_rig_from_cam(field.at("rig_from_cam"));
  if (field.at("stream").exists()) camera.stream = field.at("stream").integer(0, kMaxRigCameras - 1);
  camera.shutter = read_shutter(field.at("rolling_shutter"));
  if (field.at("mask").exists()) {
    camera.mask_path = field.at("mask").text();
    if (camera.mask_path.empty()) field.at("mask").report("the path of an image");
  }
  return camera;
}

}  // namespace

Rig read_camera_yaml(const ConfigField& root) {
  root.allow_only({"raysfm_camera", "cameras"});
  root.at("raysfm_camera").integer(1, 1);
  const std::vector<ConfigField> fields = root.at("cameras").list();
  if (fields.empty() || fields.size() > kMaxRigCameras) {
    root.at("cameras").report(fmt::format("a list of 1 to {} cameras", kMaxRigCameras));
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
  std::vector<std::string_view> names;
  for_each_model([&](auto model) {
    if (std::ranges::find(names, model.kName) == names.end()) names.push_back(model.kName);
  });
  return fmt::format("{}", fmt::join(names, ", "));
}

void check_intrinsics(const CameraModel& model, const ConfigField& field) {
  if (const auto problem = find_problem(model)) {
    field.problem().report(fmt::format("{}.{}", field.name(), problem->name),
                           fmt::format("{}", problem->value), std::string(problem->allowed));
  }
}

}  // namespace raysfm
