#include "raysfm/page/page_info.h"

#include <nlohmann/json.hpp>

#include "raysfm/files/text_file.h"

namespace raysfm {

namespace {

using Json = nlohmann::ordered_json;

std::vector<StageTime> stages_of(const Json& report) {
  std::vector<StageTime> times;
  try {
    for (const auto& [name, stage] : report.at("timing").items()) {
      if (!stage.is_object()) continue;
      times.push_back({name, stage.at("mean_ms"), stage.at("max_ms"), stage.at("count")});
    }
  } catch (const Json::exception&) {
    return {};
  }
  return times;
}

std::vector<std::string> texts_of(const Json& report, const char* key) {
  std::vector<std::string> texts;
  if (!report.is_object() || !report.contains(key)) return texts;
  for (const Json& text : report[key]) {
    if (text.is_string()) texts.push_back(text);
  }
  return texts;
}

}  // namespace

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

PageInfo page_info(const Report& report) {
  PageInfo info = {.title = title_of(report.input), .warnings = report.warnings};
  for (const auto& [name, stage] : report.stages) {
    info.stages.push_back({name, stage.mean_ms(), stage.max_ms, stage.count});
  }
  return info;
}

PageInfo read_page_info(const std::filesystem::path& folder) {
  const Result<std::string> text = read_text_file(folder / "report.json", kMaxReportBytes);
  const Json report = text ? Json::parse(*text, nullptr, false) : Json();
  const std::string input = title_of(texts_of(report, "input")), own = title_of({folder.string()});
  return {.title = input.empty() || input == own ? own : input + " · " + own,
          .stages = stages_of(report),
          .warnings = texts_of(report, "warnings")};
}

}  // namespace raysfm
