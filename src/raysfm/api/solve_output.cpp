#include <string>
#include <vector>

#include "raysfm/api/solve.h"
#include "raysfm/plots/lens_plot.h"
#include "raysfm/results/lens_file.h"
#include "raysfm/results/output_folder.h"
#include "raysfm/results/world_writers.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;

constexpr const char* kPlot = "lens.png";

}  // namespace

Result<void> check_solve_output(const fs::path& input, const fs::path& folder) {
  std::vector<std::string> inputs = {input.string()};
  // Files of a sequence are called as results are.
  for (const char* name : {kPlot, "config.yaml", "report.json"}) inputs.push_back((input / name).string());
  for (const WorldWriter& writer : world_writers()) inputs.push_back((input / writer.name).string());
  return check_output_folder(folder, inputs, std::vector<std::string>{kPlot});
}

Result<void> write_solve_output(const SolveResult& result, const SolveSettings& settings,
                                const std::string& version, const fs::path& folder) {
  SolveSettings effective = settings;
  Report report = result.report;
  report.version = version;
  const std::vector<LensOfFrame> lenses = lenses_of_frames(result.reconstruction);
  std::vector<ResultFile> more;
  if (!lenses.empty()) more.push_back({kPlot, [&](const fs::path& path) { return plot_lens(lenses, path); }});
  const Result<bool> written = write_output_folder(
      result.reconstruction, std::move(report),
      effective_config(setting_fields(effective), {settings.input}, version), folder, more);
  return written ? Result<void>() : written.error();
}

}  // namespace raysfm
