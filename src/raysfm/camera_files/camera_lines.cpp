#include "raysfm/camera_files/camera_lines.h"

#include <fmt/format.h>

#include <cmath>

namespace raysfm {

std::vector<double> finite_numbers(const std::vector<std::string_view>& words, size_t first, size_t last,
                                   const std::string& field, ConfigProblem* problem) {
  std::vector<double> values;
  for (size_t i = first; i < std::min(last, words.size()); ++i) {
    const std::optional<double> value = parse_number(words[i]);
    const bool finite = value && std::isfinite(*value);
    if (!finite) problem->report(field, "'" + shown(words[i]) + "'", "finite numbers");
    values.push_back(finite ? *value : 0);
  }
  return values;
}

int64_t integer_word(std::string_view word, int64_t low, int64_t high, const std::string& field,
                     ConfigProblem* problem) {
  const std::optional<int64_t> value = parse_integer(word);
  if (value && *value >= low && *value <= high) return *value;
  problem->report(field, "'" + shown(word) + "'", fmt::format("an integer from {} to {}", low, high));
  return low;
}

}  // namespace raysfm
