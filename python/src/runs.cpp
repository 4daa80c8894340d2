#include <pybind11/stl.h>

#include "long_call.h"
#include "raysfm/adjustment/adjust.h"
#include "raysfm/api/solve.h"
#include "raysfm/api/track.h"
#include "raysfm/results/output_folder.h"
#include "run.h"
#include "support.h"

namespace raysfm::python {
namespace {

// Functions of the caller's; None: none.
struct Listeners {
  py::object progress, event;
};

// What the caller hears.
template <typename Callbacks>
Callbacks callbacks_of(const Listeners& listeners, LongCall* call) {
  Callbacks callbacks;
  callbacks.stop = call->stop();
  if (!listeners.event.is_none()) {
    callbacks.event = [&listeners, call](const Event& event) {
      const char* level = event.level == Event::Level::kWarning ? "warning" : "info";
      call->call_back([&] { listeners.event(level, text(event.message)); });
    };
  }
  return callbacks;
}

template <typename... Arguments>
void tell_progress(const py::object& function, LongCall* call, const Arguments&... arguments) {
  call->call_back([&] { function(arguments...); });
}

Result<bool> as_written(const Result<void>& written) {
  return written ? Result<bool>(true) : written.error();
}

Run run_track(const py::object& inputs, const py::object& out, Listeners listeners, const py::kwargs& given) {
  TrackSettings settings;
  settings.inputs = paths_of(inputs, "inputs");
  if (settings.inputs.empty()) raise(bad_input("INPUT is missing"));
  set_settings("track", given, setting_fields(settings));
  const std::string folder = out.is_none() ? "" : path_of(out);
  LongCall call;
  auto callbacks = callbacks_of<TrackCallbacks>(listeners, &call);
  if (!out.is_none()) callbacks.ready = [&] { return prepare_track_output(settings, folder); };
  if (!listeners.progress.is_none()) {
    callbacks.progress = [&](const TrackProgress& p) {
      tell_progress(listeners.progress, &call, p.frames, p.total, p.posed);
    };
  }
  auto result = std::make_shared<TrackResult>(unwrap(call.run([&] { return track(settings, callbacks); })));
  Run run = run_of(result, [settings](const TrackResult& r, const std::string& path) {
    return write_track_output(r, settings, RAYSFM_VERSION, path);
  });
  const bool written = out.is_none() || write_run(run, out);
  if (result->reconstruction.segments.empty() && !result->report.interrupted) {
    raise_with_result(why_no_pose(*result, written, folder), py::cast(run));
  }
  return run;
}

Run run_solve(const py::object& input, const py::object& out, Listeners listeners, const py::kwargs& given) {
  SolveSettings settings;
  settings.input = path_of(input);
  set_settings("solve", given, setting_fields(settings));
  const std::string folder = out.is_none() ? "" : path_of(out);
  LongCall call;
  auto callbacks = callbacks_of<SolveCallbacks>(listeners, &call);
  if (!out.is_none()) {
    callbacks.ready = [&]() -> Result<void> {
      if (auto r = check_solve_output(settings.input, folder); !r) return r;
      return prepare_output_folder(folder);
    };
  }
  if (!listeners.progress.is_none()) {
    callbacks.progress = [&](const char* stage, int done, int total) {
      tell_progress(listeners.progress, &call, stage, done, total);
    };
  }
  Run run =
      run_of(std::make_shared<SolveResult>(unwrap(call.run([&] { return solve(settings, callbacks); }))),
             [settings](const SolveResult& r, const std::string& path) {
               return as_written(write_solve_output(r, settings, RAYSFM_VERSION, path));
             });
  if (!out.is_none()) write_run(run, out);
  return run;
}

Run run_adjust(const py::object& input, const py::object& out, Listeners listeners, const py::kwargs& given) {
  AdjustSettings settings;
  settings.input = path_of(input);
  set_settings("adjust", given, setting_fields(settings));
  const std::string folder = out.is_none() ? "" : path_of(out);
  LongCall call;
  auto callbacks = callbacks_of<AdjustCallbacks>(listeners, &call);
  if (!out.is_none()) {
    callbacks.ready = [&]() -> Result<void> {
      if (auto r = check_adjust_output(settings.input, folder); !r) return r;
      return prepare_output_folder(folder);
    };
  }
  int iterations = 0;
  if (!listeners.progress.is_none()) {
    callbacks.progress = [&](const IterationInfo& info) {
      tell_progress(listeners.progress, &call, ++iterations, info.cost);
    };
  }
  Run run =
      run_of(std::make_shared<AdjustResult>(unwrap(call.run([&] { return adjust(settings, callbacks); }))),
             [settings](const AdjustResult& r, const std::string& path) {
               return as_written(write_adjust_output(r, settings, RAYSFM_VERSION, path));
             });
  if (!out.is_none()) write_run(run, out);
  return run;
}

template <typename Function>
void bind_run(py::module_& module, const char* name, const char* input, const Function& function,
              const char* doc) {
  module.def(
      name,
      [function](const py::object& given, const py::object& out, const py::object& progress,
                 const py::object& event, const py::kwargs& settings) {
        return function(given, out, Listeners{progress, event}, settings);
      },
      py::arg(input), py::kw_only(), py::arg("out") = py::none(), py::arg("progress") = py::none(),
      py::arg("event") = py::none(), doc);
}

}  // namespace

void bind_runs(py::module_& module) {
  bind_run(
      module, "track", "inputs", run_track,
      "Video of a camera or a rig to trajectory and map, as `raysfm track`. `inputs` is a path or a list "
      "of them; further keywords are the program's options, \"-\" written as \"_\". With `out` the result "
      "is written there as well. `progress(frames, total, posed)` and `event(level, message)` are called "
      "as it runs; where one raises Stop the run ends early with what there is. "
      "NoReconstructionError where no frame has a pose.");
  bind_run(module, "solve", "input", run_solve,
           "Unknown or zooming lens, as `raysfm solve`: a video, images or a file of point tracks. "
           "`progress(stage, done, total)`; else as track().");
  bind_run(module, "adjust", "input", run_adjust,
           "Bundle adjustment of a BAL file or a COLMAP model, as `raysfm adjust`. "
           "`progress(iteration, cost)`; else as track().");
}

}  // namespace raysfm::python
