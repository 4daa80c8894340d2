#include "raysfm/core/time_range.h"

#include <fmt/format.h>

#include <utility>

namespace raysfm {

Result<void> check_range(const TimeRange& range) {
  constexpr double kMostSeconds = 1e12;
  for (const auto& [name, seconds] : {std::pair("from", range.from), std::pair("to", range.to)}) {
    if (seconds >= 0 && seconds <= kMostSeconds) continue;
    return bad_input(fmt::format("--{} = {}: must be 0 to {:g} seconds", name, seconds, kMostSeconds));
  }
  if (range.to <= 0 || range.to > range.from) return {};
  return bad_input(fmt::format("--to = {}: must be more than --from, {} seconds", range.to, range.from));
}

Error no_frames_in(const TimeRange& range, const std::string& stream) {
  const std::string end = range.to > 0 ? fmt::format(" to {:g} seconds", range.to) : " seconds on";
  return bad_input(fmt::format("{}: no frame from {:g}{}", stream, range.from, end));
}

}  // namespace raysfm
