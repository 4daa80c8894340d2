#include "raysfm/camera_files/camera_convert.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "raysfm/camera_files/camera_file.h"
#include "raysfm/camera_files/camera_format.h"

namespace raysfm {
namespace {

using Models = std::vector<CameraModel>;

void equivalents(const Pinhole& m, Models* out) {
  out->push_back(Radtan{m.fx, m.fy, m.cx, m.cy});
  out->push_back(Rational{m.fx, m.fy, m.cx, m.cy});
  out->push_back(Unified{m.fx, m.fy, m.cx, m.cy});
  out->push_back(DoubleSphere{m.fx, m.fy, m.cx, m.cy});
  out->push_back(Eucm{m.fx, m.fy, m.cx, m.cy, 0, 1});
}

void equivalents(const Radtan& m, Models* out) {
  if (m.k1 == 0 && m.k2 == 0 && m.p1 == 0 && m.p2 == 0 && m.k3 == 0) {
    const Pinhole pinhole{m.fx, m.fy, m.cx, m.cy};
    out->push_back(pinhole);
    return equivalents(pinhole, out);
  }
  out->push_back(Rational{m.fx, m.fy, m.cx, m.cy, m.k1, m.k2, m.p1, m.p2, m.k3});
  if (m.k3 == 0) out->push_back(Unified{m.fx, m.fy, m.cx, m.cy, 0, m.k1, m.k2, m.p1, m.p2});
}

void equivalents(const Rational& m, Models* out) {
  if (m.k4 != 0 || m.k5 != 0 || m.k6 != 0) return;
  const Radtan radtan{m.fx, m.fy, m.cx, m.cy, m.k1, m.k2, m.p1, m.p2, m.k3};
  out->push_back(radtan);
  equivalents(radtan, out);
}

void equivalents(const Unified& m, Models* out) {
  if (m.k1 == 0 && m.k2 == 0 && m.p1 == 0 && m.p2 == 0) {
    const double scale = 1 / (1 + m.xi), alpha = m.xi * scale;
    out->push_back(Eucm{m.fx * scale, m.fy * scale, m.cx, m.cy, alpha, 1});
    out->push_back(DoubleSphere{m.fx * scale, m.fy * scale, m.cx, m.cy, 0, alpha});
    if (m.xi == 0) out->push_back(Pinhole{m.fx, m.fy, m.cx, m.cy});
  }
  if (m.xi == 0) out->push_back(Radtan{m.fx, m.fy, m.cx, m.cy, m.k1, m.k2, m.p1, m.p2});
}

void equivalents(const Eucm& m, Models* out) {
  if (m.beta != 1) return;
  out->push_back(DoubleSphere{m.fx, m.fy, m.cx, m.cy, 0, m.alpha});
  if (m.alpha < 1) {
    const double scale = 1 / (1 - m.alpha);
    out->push_back(Unified{m.fx * scale, m.fy * scale, m.cx, m.cy, m.alpha * scale});
  }
}

void equivalents(const DoubleSphere& m, Models* out) {
  if (m.xi != 0) return;
  const Eucm eucm{m.fx, m.fy, m.cx, m.cy, m.alpha, 1};
  out->push_back(eucm);
  equivalents(eucm, out);
}

template <typename Model>
void equivalents(const Model&, Models*) {}

// How a format is written: what it calls its models, and its files.
struct Format {
  std::string_view name;
  std::vector<std::string_view> models;
  bool (*holds)(const CameraModel& model);  // beyond the name of the model
  Result<std::vector<CameraFileText>> (*write)(const Rig& rig);
};

bool anything(const CameraModel&) {
  return true;
}

bool without_k3(const CameraModel& model) {
  const auto* radtan = std::get_if<Radtan>(&model);
  return !radtan || radtan->k3 == 0;
}

Result<std::vector<CameraFileText>> write_raysfm(const Rig& rig) {
  return std::vector<CameraFileText>{{"camera.yaml", format_camera_file(rig)}};
}

const std::vector<Format>& formats() {
  static const std::vector<Format> all = {
      {"raysfm",
       {"pinhole", "radtan", "rational", "kannala-brandt", "unified", "double-sphere", "eucm", "ocam",
        "equirectangular", "mirror", "ray-table"},
       anything,
       write_raysfm},
      {"kalibr",
       {"pinhole", "radtan", "kannala-brandt", "unified", "double-sphere", "eucm"},
       without_k3,
       format_kalibr},
      {"opencv", {"pinhole", "radtan", "rational", "kannala-brandt", "unified"}, anything, format_opencv},
      {"colmap", {"pinhole", "radtan", "rational", "kannala-brandt", "eucm"}, anything, format_colmap},
      {"basalt", {"pinhole", "kannala-brandt", "double-sphere", "eucm"}, anything, format_basalt},
      {"ocamcalib", {"ocam"}, anything, format_ocamcalib},
      {"generic", {"ray-table"}, anything, format_generic},
  };
  return all;
}

const Format* find_format(std::string_view name) {
  const auto found = std::ranges::find(formats(), name, &Format::name);
  return found == formats().end() ? nullptr : &*found;
}

bool holds(const Format& format, const CameraModel& model) {
  return std::ranges::find(format.models, model_name(model)) != format.models.end() && format.holds(model);
}

}  // namespace

std::vector<CameraModel> equivalent_models(const CameraModel& model) {
  Models out = {model};
  std::visit([&](const auto& m) { equivalents(m, &out); }, model);
  return out;
}

const std::vector<std::string_view>& camera_formats() {
  static const std::vector<std::string_view> names = [] {
    std::vector<std::string_view> all;
    for (const Format& format : formats()) all.push_back(format.name);
    return all;
  }();
  return names;
}

std::vector<std::string_view> models_of_format(std::string_view format) {
  const Format* known = find_format(format);
  return known ? known->models : std::vector<std::string_view>{};
}

bool format_holds(std::string_view format, const CameraModel& model) {
  const Format* known = find_format(format);
  return known && holds(*known, model);
}

Result<std::vector<CameraFileText>> format_cameras(const Rig& rig, std::string_view format) {
  const Format* known = find_format(format);
  if (!known)
    return bad_input(fmt::format("format '{}'; allowed: {}", format, fmt::join(camera_formats(), ", ")));
  Rig written = rig;
  for (Camera& camera : written.cameras) {
    if (camera.width == 0) {
      return bad_input(
          fmt::format("{}: resolution: missing; allowed: a camera file that says the size of the "
                      "images, or --size WIDTH HEIGHT",
                      camera.name));
    }
    const Models models = equivalent_models(camera.model);
    const auto usable = std::ranges::find_if(models, [&](const CameraModel& m) { return holds(*known, m); });
    if (usable == models.end()) {
      return bad_input(fmt::format("{}: model {} is not written by format {} as it is; allowed: {}, or --fit",
                                   camera.name, model_name(camera.model), format,
                                   fmt::join(known->models, ", ")));
    }
    const CameraModel& chosen = *usable;
    camera.model = chosen;
  }
  return known->write(written);
}

}  // namespace raysfm
