#include "raysfm/adjustment/adjust_model.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <string>
#include <system_error>
#include <vector>

#include "raysfm/adjustment/adjust.h"
#include "raysfm/bundle/bal_problem.h"
#include "raysfm/geometry/rotation.h"
#include "raysfm/results/output_folder.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;

constexpr const char* kModelFolder = "sparse";

Result<void> write_model(const BalFile& file, const fs::path& path) {
  return write_bal_file(file, path);
}
Result<void> write_model(const ColmapModel& model, const fs::path& path) {
  return write_colmap_model(model, path);
}

// The part of the file that takes part.
BalProblem problem_of(const BalFile& file, const AdjustSelection& selection) {
  BalProblem problem;
  for (const int i : selection.images) problem.cameras.push_back(file.cameras[i]);
  for (const int i : selection.points) problem.points.push_back(file.points[i]);
  for (const BalObservation& o : file.observations) {
    const int point = selection.point_number[o.point];
    if (point >= 0) problem.observations.push_back({selection.image_number[o.camera], point, o.pixel});
  }
  return problem;
}

// Root mean square of the reprojection errors of the observations whose point is before its camera.
double rms_of(const BalProblem& problem) {
  double sum = 0;
  int64_t count = 0;
  for (const BalProblem::Observation& o : problem.observations) {
    const auto& c = problem.cameras[o.camera];
    const Eigen::Vector3d p =
        exp_so3({c[0], c[1], c[2]}) * problem.points[o.point] + Eigen::Vector3d(c[3], c[4], c[5]);
    if (!(p.z() < 0)) continue;
    const Eigen::Vector2d n = -p.head<2>() / p.z();
    const double q = n.squaredNorm();
    const double squared = (c[6] * (1 + q * (c[7] + q * c[8])) * n - o.pixel).squaredNorm();
    if (!std::isfinite(squared)) continue;
    sum += squared;
    ++count;
  }
  return count > 0 ? std::sqrt(sum / static_cast<double>(count)) : 0.0;
}

}  // namespace

AdjustSelection::AdjustSelection(std::span<const SeenPoint> seen, const std::vector<int>& image_order,
                                 int point_count) {
  // Seeing a point twice does not place it.
  constexpr int kUnseen = -1, kByTwo = -2;
  std::vector<int> seen_by(point_count, kUnseen);
  for (const SeenPoint& s : seen) {
    int& by = seen_by[s.point];
    if (by == kUnseen) {
      by = s.image;
    } else if (by != s.image) {
      by = kByTwo;
    }
  }
  point_number.assign(point_count, -1);
  for (int i = 0; i < point_count; ++i) {
    if (seen_by[i] != kByTwo) continue;
    point_number[i] = static_cast<int>(points.size());
    points.push_back(i);
  }
  image_number.assign(image_order.size(), -1);
  std::vector<bool> sees(image_order.size(), false);
  for (const SeenPoint& s : seen) {
    if (point_number[s.point] >= 0) sees[s.image] = true;
  }
  for (const int i : image_order) {
    if (!sees[i]) continue;
    image_number[i] = static_cast<int>(images.size());
    images.push_back(i);
  }
}

bool keeps_start(AdjustOutcome* outcome) {
  BundleSummary& summary = outcome->summary;
  outcome->kept_start = !(summary.final_cost <= summary.initial_cost);
  if (!outcome->kept_start) return false;
  summary.final_cost = summary.initial_cost;
  outcome->final_rms_px = outcome->initial_rms_px;
  if (summary.termination != Termination::kInterrupted) summary.termination = Termination::kNoProgress;
  return true;
}

fs::path adjusted_name(const fs::path& input) {
  std::error_code ignored;
  if (fs::is_directory(input, ignored)) return kModelFolder;
  fs::path name = input.filename();
  const bool packed = name.extension() == ".bz2";
  if (packed) name = name.stem();
  if (name.extension() == ".txt") name = name.stem();
  name += packed ? ".txt.bz2" : ".txt";
  return name;
}

Result<void> check_adjust_output(const fs::path& input, const fs::path& folder) {
  const std::vector<std::string> inputs = {input.string(), model_folder(input).string()};
  return check_output_folder(folder, inputs, std::vector{adjusted_name(input).string()});
}

Result<void> write_adjust_output(const AdjustResult& result, const AdjustSettings& settings,
                                 const std::string& version, const fs::path& folder) {
  AdjustSettings effective = settings;
  Report report = result.report;
  report.version = version;
  const ResultFile model = {report.model->name, [&](const fs::path& path) {
                              return std::visit([&](const auto& m) { return write_model(m, path); },
                                                result.model);
                            }};
  const Result<bool> written = write_output_folder(
      result.reconstruction, std::move(report),
      effective_config(setting_fields(effective), {settings.input}, version), folder, std::span(&model, 1));
  return written ? Result<void>() : written.error();
}

Result<void> adjust_bal_file(const AdjustTask& task, BalFile* file, AdjustOutcome* outcome) {
  std::vector<SeenPoint> seen;
  seen.reserve(file->observations.size());
  for (const BalObservation& o : file->observations) seen.push_back({o.camera, o.point});
  std::vector<int> order(file->cameras.size());
  std::iota(order.begin(), order.end(), 0);
  const AdjustSelection selection(seen, order, static_cast<int>(file->points.size()));
  outcome->images = outcome->cameras = static_cast<int>(file->cameras.size());
  outcome->points = static_cast<int>(file->points.size());
  outcome->images_left_out = outcome->images - static_cast<int>(selection.images.size());
  outcome->points_left_out = outcome->points - static_cast<int>(selection.points.size());
  BalProblem problem = problem_of(*file, selection);
  if (problem.observations.empty())
    return no_reconstruction("nothing to adjust, no point is seen by two cameras");
  if (auto r = task.ready(); !r) return r;

  outcome->initial_rms_px = rms_of(problem);
  outcome->summary = adjust_bal(&problem, task.method, task.options);
  if (keeps_start(outcome)) return {};
  outcome->final_rms_px = rms_of(problem);
  for (size_t i = 0; i < selection.images.size(); ++i)
    file->cameras[selection.images[i]] = problem.cameras[i];
  for (size_t i = 0; i < selection.points.size(); ++i) file->points[selection.points[i]] = problem.points[i];
  return {};
}

}  // namespace raysfm
