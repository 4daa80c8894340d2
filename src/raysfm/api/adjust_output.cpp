#include <string>
#include <system_error>
#include <vector>

#include "raysfm/api/adjust.h"
#include "raysfm/api/adjust_model.h"
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
