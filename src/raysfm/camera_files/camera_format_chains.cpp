// Formats of several cameras: Kalibr, COLMAP, basalt.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <nlohmann/json.hpp>

#include "raysfm/camera_files/camera_format.h"
#include "raysfm/camera_files/colmap_camera.h"

namespace raysfm {
namespace {

// Parameters [first, last) of a model.
template <typename Model>
std::vector<double> part(const Model& model, size_t first, size_t last) {
  const auto p = model.parameters();
  return {p.begin() + first, p.begin() + last};
}

struct KalibrModel {
  std::string camera_model, distortion_model;
  std::vector<double> intrinsics, coefficients;
};

KalibrModel kalibr_model(const Pinhole& m) {
  return {"pinhole", "none", part(m, 0, 4), {}};
}
KalibrModel kalibr_model(const Radtan& m) {
  return {"pinhole", "radtan", part(m, 0, 4), part(m, 4, 8)};
}
KalibrModel kalibr_model(const KannalaBrandt& m) {
  return {"pinhole", "equidistant", part(m, 0, 4), part(m, 4, 8)};
}
KalibrModel kalibr_model(const Unified& m) {
  return {"omni", "radtan", {m.xi, m.fx, m.fy, m.cx, m.cy}, part(m, 5, 9)};
}
KalibrModel kalibr_model(const DoubleSphere& m) {
  return {"ds", "none", {m.xi, m.alpha, m.fx, m.fy, m.cx, m.cy}, {}};
}
KalibrModel kalibr_model(const Eucm& m) {
  return {"eucm", "none", {m.alpha, m.beta, m.fx, m.fy, m.cx, m.cy}, {}};
}
template <typename Model>
KalibrModel kalibr_model(const Model&) {
  return {};
}

std::string matrix_rows(const Rigid3& motion) {
  const Eigen::Matrix3d r = motion.rotation.toRotationMatrix();
  std::string text;
  for (int i = 0; i < 3; ++i) {
    text += fmt::format("  - [{}, {}, {}, {}]\n", r(i, 0), r(i, 1), r(i, 2), motion.translation(i));
  }
  return text + "  - [0.0, 0.0, 0.0, 1.0]\n";
}

}  // namespace

Result<std::vector<CameraFileText>> format_kalibr(const Rig& rig) {
  std::string text;
  for (size_t i = 0; i < rig.cameras.size(); ++i) {
    const Camera& camera = rig.cameras[i];
    const KalibrModel m = std::visit([](const auto& model) { return kalibr_model(model); }, camera.model);
    text += fmt::format("cam{}:\n", i);
    if (i > 0) {
      text += "  T_cn_cnm1:\n" + matrix_rows(camera.rig_from_cam.inverse() * rig.cameras[i - 1].rig_from_cam);
    }
    text += fmt::format(
        "  camera_model: {}\n  distortion_coeffs: [{}]\n  distortion_model: {}\n  intrinsics: [{}]\n"
        "  resolution: [{}, {}]\n  rostopic: /cam{}/image_raw\n",
        m.camera_model, fmt::join(m.coefficients, ", "), m.distortion_model, fmt::join(m.intrinsics, ", "),
        camera.width, camera.height, i);
  }
  return std::vector<CameraFileText>{{"camchain.yaml", text}};
}

Result<std::vector<CameraFileText>> format_colmap(const Rig& rig) {
  std::string cameras = "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n";
  std::string sensors;
  const Rigid3 rig_from_first = rig.cameras.front().rig_from_cam;
  for (size_t i = 0; i < rig.cameras.size(); ++i) {
    const Camera& camera = rig.cameras[i];
    const std::optional<ColmapCamera> colmap = colmap_camera(camera.model);
    if (!colmap) return bad_input(fmt::format("{}: COLMAP has no such model", camera.name));
    cameras += fmt::format("{} {} {} {} {}\n", i + 1, find_colmap_model(colmap->model)->name, camera.width,
                           camera.height, fmt::join(colmap->parameters, " "));
    if (i == 0) continue;
    const Rigid3 cam_from_first = camera.rig_from_cam.inverse() * rig_from_first;
    const Eigen::Quaterniond& q = cam_from_first.rotation;
    const Eigen::Vector3d& t = cam_from_first.translation;
    sensors += fmt::format(" CAMERA {} 1 {} {} {} {} {} {} {}", i + 1, q.w(), q.x(), q.y(), q.z(), t.x(),
                           t.y(), t.z());
  }
  std::vector<CameraFileText> files = {{"cameras.txt", cameras}};
  if (rig.cameras.size() > 1) {
    files.push_back(
        {"rigs.txt",
         "# RIG_ID, NUM_SENSORS, REF_SENSOR_TYPE, REF_SENSOR_ID, SENSORS[] as (SENSOR_TYPE, SENSOR_ID, "
         "HAS_POSE, [QW, QX, QY, QZ, TX, TY, TZ])\n" +
             fmt::format("1 {} CAMERA 1{}\n", rig.cameras.size(), sensors)});
  }
  return files;
}

namespace {

struct BasaltModel {
  std::string type;
  std::vector<const char*> names;  // behind fx, fy, cx, cy
};

BasaltModel basalt_model(const CameraModel& model) {
  if (std::holds_alternative<KannalaBrandt>(model)) return {"kb4", {"k1", "k2", "k3", "k4"}};
  if (std::holds_alternative<DoubleSphere>(model)) return {"ds", {"xi", "alpha"}};
  if (std::holds_alternative<Eucm>(model)) return {"eucm", {"alpha", "beta"}};
  return {"pinhole", {}};
}

nlohmann::ordered_json basalt_intrinsics(const CameraModel& model) {
  const BasaltModel basalt = basalt_model(model);
  nlohmann::ordered_json numbers;
  std::visit(
      [&]<typename Model>(const Model& m) {
        if constexpr (ParametricModel<Model>) {
          const auto p = m.parameters();
          std::vector<const char*> names = {"fx", "fy", "cx", "cy"};
          names.insert(names.end(), basalt.names.begin(), basalt.names.end());
          for (size_t i = 0; i < names.size(); ++i) numbers[names[i]] = p[i];
        }
      },
      model);
  return {{"camera_type", basalt.type}, {"intrinsics", numbers}};
}

}  // namespace

Result<std::vector<CameraFileText>> format_basalt(const Rig& rig) {
  nlohmann::ordered_json value;
  value["T_imu_cam"] = nlohmann::ordered_json::array();
  value["intrinsics"] = nlohmann::ordered_json::array();
  value["resolution"] = nlohmann::ordered_json::array();
  for (const Camera& camera : rig.cameras) {
    const Rigid3& pose = camera.rig_from_cam;
    value["T_imu_cam"].push_back({{"px", pose.translation.x()},
                                  {"py", pose.translation.y()},
                                  {"pz", pose.translation.z()},
                                  {"qx", pose.rotation.x()},
                                  {"qy", pose.rotation.y()},
                                  {"qz", pose.rotation.z()},
                                  {"qw", pose.rotation.w()}});
    value["intrinsics"].push_back(basalt_intrinsics(camera.model));
    value["resolution"].push_back({camera.width, camera.height});
  }
  const nlohmann::ordered_json root = {{"value0", value}};
  return std::vector<CameraFileText>{{"calib.json", root.dump(2) + "\n"}};
}

}  // namespace raysfm
