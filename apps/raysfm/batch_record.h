#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "batch_list.h"
#include "raysfm/core/result.h"

namespace raysfm::app {

// What became of a job, kept in DIR/batch/NAME.json.
struct BatchRecord {
  std::vector<std::string> arguments;  // that it was run with
  std::string version;                 // of the program
  int exit_code = 0;
  std::string reason;  // why there is no result; empty: there is
  double seconds = 0;
};

// Where the parts of a batch lie.
struct BatchFolder {
  std::filesystem::path folder;  // absolute

  std::filesystem::path result(const BatchJob& job) const { return folder / job.name; }
  std::filesystem::path records() const { return folder / "batch"; }
  std::filesystem::path record(const BatchJob& job) const { return records() / (job.name + ".json"); }
  std::filesystem::path log(const BatchJob& job) const { return records() / (job.name + ".log"); }
  std::filesystem::path table() const { return folder / "batch.csv"; }
};

// nullopt where there is none, or none that this program wrote.
std::optional<BatchRecord> read_record(const BatchFolder& folder, const BatchJob& job);
Result<void> write_record(const BatchRecord& record, const BatchFolder& folder, const BatchJob& job);

// Whether nothing need be done any more: a result, or that there can be none, of the same line and version.
bool is_finished(const std::optional<BatchRecord>& record, const BatchFolder& folder, const BatchJob& job);

// The table of all jobs as CSV and to be read.
struct BatchTable {
  std::string csv, text;
  int without_result = 0;
  int exit_code = 0;  // 0, or that of the first job without a result
};
BatchTable batch_table(const std::vector<BatchJob>& jobs, const BatchFolder& folder);

}  // namespace raysfm::app
