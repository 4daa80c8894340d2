#include "raysfm/api/adjust.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <system_error>

#include "raysfm/api/adjust_model.h"
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

Result<void> read_and_adjust(const AdjustSettings& settings, const AdjustTask& task, const EventSink& event,
                             AdjustResult* result) {
  const Clock::time_point start = Clock::now();
  if (!is_folder(settings.input)) {
    Result<BalFile> file = read_bal_file(settings.input);
    if (!file) return file.error();
    result->read_s = milliseconds_since(start) / 1000.0;
    result->model = *std::move(file);
    return adjust_bal_file(task, &std::get<BalFile>(result->model), result);
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
  result->read_s = milliseconds_since(start) / 1000.0;
  result->model = *std::move(model);
  return adjust_colmap_model(task, folder, &std::get<ColmapModel>(result->model), result);
}

void tell_what_is_left_out(const AdjustResult& result, const EventSink& event) {
  const AdjustCounts& c = result.counts;
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
  if (result.summary.dropped_observations > 0) {
    tell(event, Event::Level::kWarning,
         fmt::format("{} observations are dropped, their point is behind the camera or outside its view",
                     result.summary.dropped_observations));
  }
  if (result.kept_start) {
    tell(event, Event::Level::kWarning,
         "the adjustment would have raised the cost of the whole; the model stays as it was");
  }
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
  AdjustResult result;
  const AdjustTask task = task_of(settings, callbacks);
  if (auto r = read_and_adjust(settings, task, callbacks.event, &result); !r) {
    if (r.error().kind != ErrorKind::kNoReconstruction) return r.error();
    return no_reconstruction(fmt::format("{}: {}", settings.input, r.error().message));
  }
  tell_what_is_left_out(result, callbacks.event);
  if (result.summary.termination == Termination::kInvalidProblem) {
    return internal_error(fmt::format("{}: the adjustment refused its own problem", settings.input));
  }
  if (result.summary.termination == Termination::kNothingToDo) {
    return no_reconstruction(
        fmt::format("{}: nothing to adjust, no observed point is in view of its camera", settings.input));
  }
  result.interrupted = result.summary.termination == Termination::kInterrupted;
  result.wall_s = milliseconds_since(start) / 1000.0;
  result.peak_rss_mib = peak_rss_mib();
  return result;
}

}  // namespace raysfm
