#include "batch_record.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <system_error>

#include "raysfm/files/atomic_file.h"
#include "raysfm/files/text_file.h"
#include "raysfm/results/report_file.h"

namespace raysfm::app {
namespace {

using Json = nlohmann::ordered_json;

constexpr uintmax_t kMaxRecordBytes = 1 << 20;
constexpr int kNoReconstruction = 3, kBadInput = 2;  // exit codes

// Of report.json, as far as it has them.
struct Counts {
  int frames = 0, posed = 0, worlds = 0;
};

Counts counts_of(const std::filesystem::path& folder) {
  const Result<std::string> text = read_text_file(folder / "report.json", kMaxReportBytes);
  const Json json = text ? Json::parse(*text, nullptr, false) : Json();
  if (!json.is_object()) return {};
  const auto number = [](const Json& value) { return value.is_number_integer() ? value.get<int>() : 0; };
  Counts counts;
  if (const auto frames = json.find("frames"); frames != json.end() && frames->is_object()) {
    counts.frames = number(frames->value("total", Json()));
    counts.posed = number(frames->value("posed", Json()));
  }
  if (const auto worlds = json.find("worlds"); worlds != json.end())
    counts.worlds = static_cast<int>(worlds->size());
  return counts;
}

std::string csv_field(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? "\"\"" : std::string(1, c);
  return quoted + "\"";
}

}  // namespace

std::optional<BatchRecord> read_record(const BatchFolder& folder, const BatchJob& job) {
  const Result<std::string> text = read_text_file(folder.record(job), kMaxRecordBytes);
  const Json json = text ? Json::parse(*text, nullptr, false) : Json();
  try {
    return BatchRecord{json.at("arguments").get<std::vector<std::string>>(),
                       json.at("version").get<std::string>(), json.at("exit").get<int>(),
                       json.at("reason").get<std::string>(), json.at("seconds").get<double>()};
  } catch (const Json::exception&) {
    return std::nullopt;
  }
}

Result<void> write_record(const BatchRecord& record, const BatchFolder& folder, const BatchJob& job) {
  const Json json = {{"arguments", record.arguments},
                     {"version", record.version},
                     {"exit", record.exit_code},
                     {"reason", record.reason},
                     {"seconds", record.seconds}};
  return write_file(folder.record(job), json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n");
}

bool is_finished(const std::optional<BatchRecord>& record, const BatchFolder& folder, const BatchJob& job) {
  if (!record || record->arguments != job.arguments || record->version != RAYSFM_VERSION) return false;
  std::error_code failure;
  const std::filesystem::path result = folder.result(job);
  if (record->exit_code == kNoReconstruction) return std::filesystem::exists(result, failure);
  return record->exit_code == 0 && std::filesystem::exists(result / "report.json", failure);
}

BatchTable batch_table(const std::vector<BatchJob>& jobs, const BatchFolder& folder) {
  BatchTable table;
  table.csv = "name,frames,posed,worlds,seconds,exit,reason\n";
  size_t width = 4;
  for (const BatchJob& job : jobs) width = std::max(width, job.name.size());
  table.text = fmt::format("{:<{}}  frames   posed  worlds  seconds  exit  reason\n", "name", width);
  for (const BatchJob& job : jobs) {
    std::optional<BatchRecord> record = read_record(folder, job);
    const bool current = record && record->arguments == job.arguments;
    if (!current) record = BatchRecord{{}, "", kBadInput, "not run yet", 0};
    if (!job.fault.empty()) record = BatchRecord{{}, "", kBadInput, job.fault, 0};
    const bool done = is_finished(record, folder, job);
    const Counts counts = done ? counts_of(folder.result(job)) : Counts{};
    table.csv += fmt::format("{},{},{},{},{:.3f},{},{}\n", csv_field(job.name), counts.frames, counts.posed,
                             counts.worlds, record->seconds, record->exit_code, csv_field(record->reason));
    table.text += fmt::format("{:<{}}  {:>6}  {:>6}  {:>6}  {:>7.1f}  {:>4}{}{}\n", job.name, width,
                              counts.frames, counts.posed, counts.worlds, record->seconds, record->exit_code,
                              record->reason.empty() ? "" : "  ", record->reason);
    if (record->exit_code == 0) continue;
    ++table.without_result;
    if (table.exit_code == 0) table.exit_code = record->exit_code;
  }
  return table;
}

}  // namespace raysfm::app
