#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string_view>

#include "raysfm/core/result.h"

namespace raysfm {

// What is wrong with the report.json at `path`, which holds `text`, when reading it threw `thrown`: bad
// input, one line that names the file.
Error report_fault(const std::filesystem::path& path, std::string_view text,
                   const nlohmann::json::exception& thrown);

}  // namespace raysfm
