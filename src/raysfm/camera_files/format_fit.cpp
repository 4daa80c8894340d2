#include "raysfm/camera_files/format_fit.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <vector>

#include "raysfm/camera/fit_model.h"
#include "raysfm/camera_files/camera_convert.h"

namespace raysfm {
namespace {

// The nearest camera of one of these models.
Result<RayFit> best_fit(const Camera& camera, const std::vector<std::string_view>& models,
                        const std::optional<TableGrid>& grid) {
  std::optional<RayFit> best;
  std::string reason = "no model";
  for (std::string_view model : models) {
    const Result<RayFit> fit = model == "ray-table" && grid ? fit_ray_table(camera, grid->width, grid->height)
                                                            : fit_model(camera, model);
    if (!fit) {
      reason = fit.error().message;
    } else if (!best || fit->samples > best->samples ||
               (fit->samples == best->samples && fit->rms_px < best->rms_px)) {
      best = *fit;
    }
  }
  if (!best) return bad_input(fmt::format("{}: no fit: {}", camera.name, reason));
  return *best;
}

}  // namespace

Result<std::string> bring_to_format(std::string_view format, const ModelChoice& choice, Camera* camera) {
  for (const CameraModel& model : equivalent_models(camera->model)) {
    const bool wanted = choice.model.empty() || model_name(model) == choice.model;
    if (!wanted || !format_holds(format, model)) continue;
    const CameraModel chosen = model;
    camera->model = chosen;
    return std::string();
  }
  std::vector<std::string_view> models = models_of_format(format);
  if (!choice.model.empty()) models = {choice.model};
  if (!choice.fit) {
    return bad_input(
        fmt::format("{}: model {} is not the same camera as any {}; allowed: with --fit, the nearest",
                    camera->name, model_name(camera->model), fmt::join(models, ", ")));
  }
  // A table is nearest to everything: only where it is asked for, or nothing else is held.
  if (models.size() > 1) std::erase(models, "ray-table");
  const Result<RayFit> fit = best_fit(*camera, models, choice.grid);
  if (!fit) return fit.error();
  std::string report = fmt::format("{}: {} fitted to {}: rms {:.3g} px, max {:.3g} px over {} rays\n",
                                   camera->name, model_name(fit->camera.model), model_name(camera->model),
                                   fit->rms_px, fit->max_px, fit->samples);
  camera->model = fit->camera.model;
  return report;
}

}  // namespace raysfm
