#pragma once

#include <functional>
#include <memory>
#include <string>

#include "raysfm/core/result.h"
#include "raysfm/results/report_file.h"
#include "raysfm/scene/reconstruction.h"
#include "support.h"

namespace raysfm::python {

// A finished run of any command.
struct Run {
  std::shared_ptr<Reconstruction> reconstruction;
  std::string report;  // text of report.json
  std::function<Result<bool>(const std::string& folder)> write;
};

// Raises what goes wrong.
bool write_run(const Run& run, const py::handle& folder);

// What a result of the library becomes: `write` puts it into a folder.
template <typename Outcome, typename Write>
Run run_of(const std::shared_ptr<Outcome>& shared, const Write& write) {
  shared->report.version = RAYSFM_VERSION;
  return {std::shared_ptr<Reconstruction>(shared, &shared->reconstruction),
          report_json(shared->reconstruction, shared->report),
          [shared, write](const std::string& folder) -> Result<bool> { return write(*shared, folder); }};
}

}  // namespace raysfm::python
