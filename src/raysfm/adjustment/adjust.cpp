#include "raysfm/adjustment/adjust.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <system_error>

#include "raysfm/adjustment/adjust_model.h"
#include "raysfm/colmap_bal/model_reconstruction.h"
#include "raysfm/core/memory.h"
#include "raysfm/core/thread_pool.h"
#include "raysfm/core/timer.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;

constexpr int kMaxIterations = 1000000;

RobustLoss::Kind loss_kind(const std::string& name) {
  if (name == "huber") return RobustLoss::Kind::kHuber;
  if (name == "cauchy") return RobustLoss::Kind::kCauchy;
  return name == "tukey" ? RobustLoss::Kind::kTukey : RobustLoss::Kind::kNone;
}

BundleMethod method_of(const std::string& name) {
  if (name == "local") return BundleMethod::kLocal;
  return name == "hierarchical" ? BundleMethod::kHierarchical : BundleMethod::kGlobal;
}

Result<void> validate(AdjustSettings settings) {
  if (auto r = check_allowed(setting_fields(settings)); !r) return r.error();
  if (auto r = check_threads(settings.threads); !r) return r.error();
  if (settings.max_iterations < 1 || settings.max_iterations > kMaxIterations) {
    return bad_input(
        fmt::format("--max-iterations = {}: must be 1 to {}", settings.max_iterations, kMaxIterations));
  }
  if (!(settings.loss_scale > 0) || !std::isfinite(settings.loss_scale)) {
    return bad_input(fmt::format("--loss-scale = {}: must be above 0, in pixels", settings.loss_scale));
  }
  return {};
}

AdjustTask task_of(const AdjustSettings& settings, const AdjustCallbacks& callbacks) {
  AdjustTask task;
  task.method = method_of(settings.method);
  task.ready = [ready = callbacks.ready] { return ready ? ready() : Result<void>(); };
  BundleOptions& options = task.options.bundle;
  options.loss = {loss_kind(settings.loss), settings.loss_scale};
  options.max_iterations = settings.max_iterations;
  options.threads = thread_count(settings.threads);
  options.progress = [&callbacks](const IterationInfo& info) {
    if (callbacks.progress) callbacks.progress(info);
    return !callbacks.stop || !callbacks.stop->load();
  };
  return task;
}

bool is_folder(const fs::path& path) {
  std::error_code ignored;
  return fs::is_directory(path, ignored);
}

// The adjusted model; `read_s` is the time that reading took, in seconds.
Result<std::variant<BalFile, ColmapModel>> read_and_adjust(const AdjustSettings& settings,
                                                           const AdjustTask& task, const EventSink& event,
                                                           AdjustOutcome* outcome, double* read_s) {
  const Clock::time_point start = Clock::now();
  if (!is_folder(settings.input)) {
    Result<BalFile> file = read_bal_file(settings.input);
    if (!file) return file.error();
    *read_s = milliseconds_since(start) / 1000.0;
    if (auto r = adjust_bal_file(task, &*file, outcome); !r) return r.error();
    return {*std::move(file)};
  }
  const fs::path folder = model_folder(settings.input);
  if (!is_colmap_model(folder)) {
    return bad_input(
        fmt::format("{}: no model in this folder; cameras, images and points3D are expected, all "
                    "three .bin or .txt",
                    settings.input));
  }
  for (const char* rigs : {"rigs.bin", "rigs.txt"}) {
    std::error_code ignored;
    if (!fs::exists(folder / rigs, ignored)) continue;
    tell(event, Event::Level::kWarning,
         fmt::format("{} is not read, every image moves by itself", (folder / rigs).string()));
  }
  Result<ColmapModel> model = read_colmap_model(folder);
  if (!model) return model.error();
  *read_s = milliseconds_since(start) / 1000.0;
  if (auto r = adjust_colmap_model(task, folder, &*model, outcome); !r) return r.error();
  return {*std::move(model)};
}

void tell_what_is_left_out(const AdjustOutcome& c, const EventSink& event) {
  if (c.points_left_out > 0) {
    tell(event, Event::Level::kInfo,
         fmt::format("{} of {} points are left as they are, fewer than two images see them",
                     c.points_left_out, c.points));
  }
  if (c.images_left_out > 0) {
    tell(event, Event::Level::kInfo,
         fmt::format("{} of {} images are left as they are, they see no point that is adjusted",
                     c.images_left_out, c.images));
  }
  if (c.summary.dropped_observations > 0) {
    tell(event, Event::Level::kWarning,
         fmt::format("{} observations are dropped, their point is behind the camera or outside its view",
                     c.summary.dropped_observations));
  }
  if (c.kept_start) {
    tell(event, Event::Level::kWarning,
         "the adjustment would have raised the cost of the whole; the model stays as it was");
  }
}

Report adjust_report(const AdjustSettings& settings, const AdjustOutcome& outcome, bool bal) {
  const BundleSummary& s = outcome.summary;
  Report report;
  report.seed = settings.seed;
  report.input = {settings.input};
  report.camera_class = "central";
  report.error = "pixel";
  report.interrupted = s.termination == Termination::kInterrupted;
  report.adjustment = {.method = settings.method,
                       .initial_cost = s.initial_cost,
                       .final_cost = s.final_cost,
                       .iterations = s.iterations,
                       .termination = std::string(to_string(s.termination)),
                       .solve_s = s.solve_ms / 1000.0};
  report.model = {.format = bal ? "bal" : "colmap",
                  .name = adjusted_name(settings.input).string(),
                  .loss = settings.loss,
                  .loss_scale_px = settings.loss_scale,
                  .refines_intrinsics = bal,
                  .cameras = outcome.cameras,
                  .used_observations = s.used_observations,
                  .dropped_observations = s.dropped_observations,
                  .images_left_out = outcome.images_left_out,
                  .points_left_out = outcome.points_left_out,
                  .kept_start = outcome.kept_start,
                  .initial_rms_px = outcome.initial_rms_px};
  return report;
}

}  // namespace

fs::path model_folder(const fs::path& input) {
  for (const char* below : {"", "sparse", "sparse/0"}) {
    const fs::path folder = *below ? input / below : input;
    if (is_colmap_model(folder)) return folder;
  }
  return input;
}

std::vector<SettingField> setting_fields(AdjustSettings& s) {
  return {
      {"method",
       "everything at once, windows along the sequence, or halves of halves first",
       &s.method,
       {"global", "local", "hierarchical"}},
      {"loss", "loss of the reprojection error", &s.loss, {"none", "huber", "cauchy", "tukey"}},
      {"loss-scale", "pixels where the loss leaves the parabola", &s.loss_scale, {}},
      {"max-iterations", "iterations of every single adjustment", &s.max_iterations, {}},
      {"seed", "for the report; nothing here is random", &s.seed, {}},
      {"threads", "worker threads; 0 for as many as the machine has", &s.threads, {}},
  };
}

Result<AdjustResult> adjust(const AdjustSettings& settings, const AdjustCallbacks& callbacks) {
  const Clock::time_point start = Clock::now();
  if (auto r = validate(settings); !r) return r.error();
  const AdjustTask task = task_of(settings, callbacks);
  AdjustOutcome outcome;
  double read_s = 0;
  auto model = read_and_adjust(settings, task, callbacks.event, &outcome, &read_s);
  if (!model) {
    if (model.error().kind != ErrorKind::kNoReconstruction) return model.error();
    return no_reconstruction(fmt::format("{}: {}", settings.input, model.error().message));
  }
  tell_what_is_left_out(outcome, callbacks.event);
  if (outcome.summary.termination == Termination::kInvalidProblem) {
    return internal_error(fmt::format("{}: the adjustment refused its own problem", settings.input));
  }
  if (outcome.summary.termination == Termination::kNothingToDo) {
    return no_reconstruction(
        fmt::format("{}: nothing to adjust, no observed point is in view of its camera", settings.input));
  }
  AdjustResult result{*std::move(model), {}, adjust_report(settings, outcome, !is_folder(settings.input))};
  result.reconstruction = std::visit([](const auto& m) { return reconstruction_of(m); }, result.model);
  result.reconstruction.rms_reprojection_px = outcome.final_rms_px;
  result.report.adjustment->read_s = read_s;
  result.report.wall_s = milliseconds_since(start) / 1000.0;
  result.report.peak_rss_mib = peak_rss_mib();
  return result;
}

}  // namespace raysfm
