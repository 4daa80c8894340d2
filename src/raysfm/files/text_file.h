#pragma once

#include <concepts>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "raysfm/core/result.h"

namespace raysfm {

// Content of a regular file of at most `max_bytes`. Errors: bad input, naming the file; internal where memory
// is not enough.
Result<std::string> read_text_file(const std::filesystem::path& path, uintmax_t max_bytes);

// The whole of `word` as a number, decimal or with exponent, also the "1." , ".5" and "+2" that other tools
// write. Infinities and NaN are numbers here; nullopt where it is none.
std::optional<double> parse_number(std::string_view word);
std::optional<int64_t> parse_integer(std::string_view word);

// Seconds with nine decimals, or with as many digits as it takes to read the same number back.
std::string timestamp_text(double seconds);

// Parts of `text` between runs of spaces, tabs, line ends and the characters of `separators`.
std::vector<std::string_view> split_words(std::string_view text, std::string_view separators = "");

// `text` without the white space at its ends.
std::string_view trimmed(std::string_view text);

// At most 40 characters of `text` on one line, for a message.
std::string shown(std::string_view text);

// One line of a text file.
struct TextLine {
  int number;  // counted from 1
  std::string_view text;
};

// The lines of `text` that are neither blank nor comments (first character #), without white space at their
// ends.
std::vector<TextLine> content_lines(std::string_view text);
std::vector<TextLine> content_lines(const std::same_as<std::string> auto&& temporary) =
    delete;  // lines are views

}  // namespace raysfm
