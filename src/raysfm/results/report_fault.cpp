#include "raysfm/results/report_fault.h"

#include <fmt/format.h>

#include <algorithm>
#include <string>

namespace raysfm {
namespace {

constexpr int kNoSuchKey = 403;  // as the library numbers its exceptions

// The library's own words have codes in them, and speak of its functions.
std::string fault_text(std::string_view text, const nlohmann::json::exception& thrown) {
  if (const auto* damage = dynamic_cast<const nlohmann::json::parse_error*>(&thrown)) {
    const std::string_view read = text.substr(0, std::min(damage->byte, text.size()));
    return fmt::format("line {}: no valid JSON, cut off or damaged", 1 + std::ranges::count(read, '\n'));
  }
  const std::string_view what = thrown.what();
  const size_t open = what.find('\''), close = what.rfind('\'');
  if (thrown.id == kNoSuchKey && open < close)
    return fmt::format("{} is missing", what.substr(open, close + 1 - open));
  return "a value is of another kind than a run writes";
}

}  // namespace

Error report_fault(const std::filesystem::path& path, std::string_view text,
                   const nlohmann::json::exception& thrown) {
  return bad_input(fmt::format("{}: not the report of a run: {}", path.string(), fault_text(text, thrown)));
}

}  // namespace raysfm
