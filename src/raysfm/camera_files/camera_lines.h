#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "raysfm/camera_files/camera_import.h"
#include "raysfm/files/config_field.h"
#include "raysfm/files/text_file.h"

namespace raysfm {

// What the formats share that are lines of words. `field` names the line in messages.

// Words [first, last) as finite numbers; reports the first that is none.
std::vector<double> finite_numbers(const std::vector<std::string_view>& words, size_t first, size_t last,
                                   const std::string& field, ConfigProblem* problem);

// A word as an integer in [low, high]; reports others and returns low.
int64_t integer_word(std::string_view word, int64_t low, int64_t high, const std::string& field,
                     ConfigProblem* problem);

}  // namespace raysfm
