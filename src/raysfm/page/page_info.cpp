#include "raysfm/page/page_info.h"

#include <nlohmann/json.hpp>

#include "raysfm/files/text_file.h"

namespace raysfm {

std::vector<StageTime> stage_times(const Report& report) {
  std::vector<StageTime> times;
  for (const auto& [name, stage] : report.stages) {
    times.push_back({name, stage.mean_ms(), stage.max_ms, stage.count});
  }
  return times;
}

std::vector<StageTime> read_stage_times(const std::filesystem::path& folder) {
  const Result<std::string> text = read_text_file(folder / "report.json", kMaxReportBytes);
  if (!text) return {};
  std::vector<StageTime> times;
  try {
    const auto report = nlohmann::ordered_json::parse(*text);
    for (const auto& [name, stage] : report.at("timing").items()) {
      if (!stage.is_object()) continue;
      times.push_back({name, stage.at("mean_ms"), stage.at("max_ms"), stage.at("count")});
    }
  } catch (const nlohmann::json::exception&) {
    return {};
  }
  return times;
}

std::string title_of(const std::vector<std::string>& inputs) {
  std::string title;
  for (const std::string& input : inputs) {
    std::error_code failure;
    std::filesystem::path path = std::filesystem::weakly_canonical(input, failure);  // also of "." and "out/"
    if (failure) path = input;
    if (!path.has_filename()) path = path.parent_path();
    title += (title.empty() ? "" : ", ") + path.filename().string();
  }
  return title;
}

}  // namespace raysfm
