#include "raysfm/api/adjust_model.h"

#include <algorithm>
#include <string>
#include <system_error>
#include <vector>

#include "raysfm/api/adjust.h"
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

}  // namespace raysfm
