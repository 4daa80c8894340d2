#include <fmt/format.h>
#include <pybind11/stl.h>

#include <cmath>

#include "raysfm/results/evaluation_report.h"
#include "raysfm/results/output_folder.h"
#include "raysfm/results/trajectory_file.h"
#include "raysfm/scene/worlds.h"
#include "support.h"

namespace raysfm::python {
namespace {

bool is_path(const py::handle& value) {
  return py::isinstance<py::str>(value) || py::isinstance<py::bytes>(value) ||
         py::hasattr(value, "__fspath__");
}

// (timestamps, poses): n and n x 4 x 4.
Trajectory trajectory_of(const py::handle& value, const char* argument) {
  if (!py::isinstance<py::tuple>(value) || py::len(value) != 2) {
    throw py::type_error(
        fmt::format("{}: {} is not allowed, a path, a Reconstruction or (timestamps, poses) is", argument,
                    std::string_view(Py_TYPE(value.ptr())->tp_name)));
  }
  const auto pair = py::reinterpret_borrow<py::tuple>(value);
  const Doubles poses = doubles_of(pair[1], argument, 4);
  const py::ssize_t count = poses.ndim() == 3 && poses.shape(1) == 4 ? poses.shape(0) : 0;
  if (count == 0) {
    throw py::value_error(fmt::format("{}: poses of shape {} are not allowed, (n, 4, 4) is, n > 0", argument,
                                      shape_text(poses)));
  }
  const Doubles times = doubles_of(pair[0], argument, count);
  if (times.ndim() != 1) throw py::value_error(fmt::format("{}: {} timestamps are needed", argument, count));
  Trajectory out;
  for (py::ssize_t i = 0; i < count; ++i) {
    const double time = times.data()[i];
    if (!std::isfinite(time) || (i > 0 && time <= out.timestamps.back())) {
      throw py::value_error(
          fmt::format("{}: timestamp {} = {}; finite and above the one before", argument, i, time));
    }
    out.timestamps.push_back(time);
    out.world_from_cam.push_back(pose_of(poses[py::int_(i)], argument));
  }
  return out;
}

std::vector<Trajectory> worlds_of_result(const Reconstruction& r) {
  std::vector<Trajectory> out;
  for (const int segment : worlds_in_order(r)) out.push_back(posed_frames(world_of(r, segment)));
  return out;
}

Result<EvaluatedWorlds> compared(const py::object& estimate, const py::object& truth,
                                 const EvaluationOptions& options) {
  const std::string truth_path = is_path(truth) ? path_of(truth) : "truth";
  const Trajectory known =
      is_path(truth) ? unwrap(read_trajectory(truth_path)) : trajectory_of(truth, "truth");
  if (is_path(estimate)) return evaluate_folder(path_of(estimate), known, truth_path, options);
  if (py::isinstance<Reconstruction>(estimate)) {
    return evaluate_worlds(worlds_of_result(estimate.cast<const Reconstruction&>()), known, options);
  }
  return evaluate_worlds({trajectory_of(estimate, "estimate")}, known, options);
}

py::object evaluated(const py::object& estimate, const py::object& truth, const std::string& align,
                     double max_dt) {
  EvaluationOptions options{Alignment::kSim3, max_dt};
  if (align == "se3") {
    options.alignment = Alignment::kSe3;
  } else if (align == "none") {
    options.alignment = Alignment::kNone;
  } else if (align != "sim3") {
    raise(bad_input(fmt::format("--align = '{}': must be one of sim3, se3, none", align)));
  }
  if (!(max_dt >= 0) || !std::isfinite(max_dt)) {
    raise(bad_input(fmt::format("--max-dt: {} is not allowed, seconds from 0 are", max_dt)));
  }
  const EvaluatedWorlds worlds = unwrap(compared(estimate, truth, options));
  return py::module_::import("json").attr("loads")(text(evaluation_json(worlds, options.alignment)));
}

}  // namespace

void bind_evaluation(py::module_& module) {
  module.def(
      "evaluate", &evaluated, py::arg("estimate"), py::arg("truth"), py::arg("align") = "sim3",
      py::arg("max_dt") = EvaluationOptions{}.max_dt,
      "Compares an estimate with the truth, each a path, (timestamps, poses) with poses (n, 4, 4) from "
      "camera to world, or, of the estimate, a Reconstruction. The dict is what `raysfm eval --json` "
      "prints.");
}

}  // namespace raysfm::python
