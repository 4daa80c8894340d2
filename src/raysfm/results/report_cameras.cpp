#include "raysfm/results/report_cameras.h"

#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace raysfm {
namespace {

using Json = nlohmann::ordered_json;

// JSON has no infinity.
double number_or_infinity(const Json& number) {
  return number.is_null() ? std::numeric_limits<double>::infinity() : number.get<double>();
}

// Of each lens, the runs of frames that have it, over those without a pose.
std::vector<Json> frame_runs(const Reconstruction& r) {
  std::vector<Json> runs(r.lenses.size(), Json::array());
  int before = -1;
  for (int f = 0; f < static_cast<int>(r.frames.size()); ++f) {
    const int lens = r.frames[f].lens;
    if (!r.frames[f].world_from_rig || lens < 0) continue;
    if (lens == before) {
      runs[lens].back()[1] = f;
    } else {
      runs[lens].push_back({f, f});
    }
    before = lens;
  }
  return runs;
}

Json distortion_json(const FrameLens& lens) {
  const RadialDistortion radial = radial_distortion_of(lens.camera);
  if (radial.none()) return {};
  return {{"k1", radial.k1},
          {"k2", radial.k2},
          {"k1_sigma", lens.radial_sigma.k1},
          {"k2_sigma", lens.radial_sigma.k2}};
}

FrameLens read_lens(const Json& json, const Json& distortion) {
  LensVector value, sigma;
  for (int i = 0; i < 5; ++i) {
    value[i] = json.at("value").at(i);
    sigma[i] = number_or_infinity(json.at("sigma").at(i));
  }
  RadialDistortion radial;
  if (!distortion.is_null()) radial = {distortion.at("k1"), distortion.at("k2")};
  FrameLens lens = frame_lens(Lens::from_vector(value), radial);
  lens.camera.width = json.at("resolution").at(0);
  lens.camera.height = json.at("resolution").at(1);
  lens.sigma = sigma;
  if (!distortion.is_null()) {
    lens.radial_sigma = {number_or_infinity(distortion.at("k1_sigma")),
                         number_or_infinity(distortion.at("k2_sigma"))};
  }
  return lens;
}

}  // namespace

void write_rig_json(const Rig& rig, Json* report) {
  Json& cameras = (*report)["rig"] = Json::array();
  for (const Camera& camera : rig.cameras) {
    const Eigen::Quaterniond& q = camera.rig_from_cam.rotation;
    const Eigen::Vector3d& t = camera.rig_from_cam.translation;
    cameras.push_back(
        {{"name", camera.name},
         {"model", model_name(camera.model)},
         {"resolution", {camera.width, camera.height}},
         {"rig_from_cam",
          {{"rotation", {q.x(), q.y(), q.z(), q.w()}}, {"translation", {t.x(), t.y(), t.z()}}}}});
  }
}

void read_rig_json(const Json& report, Rig* rig) {
  for (size_t c = 0; c < rig->cameras.size(); ++c) {
    const Json& json = report.at("rig").at(c);
    const Json &q = json.at("rig_from_cam").at("rotation"), &t = json.at("rig_from_cam").at("translation");
    rig->cameras[c].name = json.at("name");
    rig->cameras[c].rig_from_cam = {Eigen::Quaterniond(q.at(3), q.at(0), q.at(1), q.at(2)),
                                    Eigen::Vector3d(t.at(0), t.at(1), t.at(2))};
  }
}

void write_lenses_json(const Reconstruction& r, Json* report) {
  (*report)["distortion"] = r.lenses.empty() ? Json() : distortion_json(r.lenses.front());
  Json& lenses = (*report)["lenses"] = Json::array();
  std::vector<Json> runs = frame_runs(r);
  for (size_t i = 0; i < r.lenses.size(); ++i) {
    const FrameLens& lens = r.lenses[i];
    const LensVector value = lens_of(lens).value_or(Lens{}).vector();
    lenses.push_back({{"frames", std::move(runs[i])},
                      {"resolution", {lens.camera.width, lens.camera.height}},
                      {"value", std::vector<double>(value.begin(), value.end())},
                      {"sigma", std::vector<double>(lens.sigma.begin(), lens.sigma.end())}});
  }
}

void read_lenses_json(const Json& report, Reconstruction* r) {
  for (const Json& json : report.at("lenses")) {
    for (const Json& run : json.at("frames")) {
      const int last = std::min(run.at(1).get<int>(), static_cast<int>(r->frames.size()) - 1);
      for (int f = std::max(run.at(0).get<int>(), 0); f <= last; ++f) {
        if (r->frames[f].world_from_rig) r->frames[f].lens = static_cast<int>(r->lenses.size());
      }
    }
    r->lenses.push_back(read_lens(json, report.at("distortion")));
  }
}

}  // namespace raysfm
