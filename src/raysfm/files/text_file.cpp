#include "raysfm/files/text_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <fstream>
#include <new>

namespace raysfm {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kSpace = " \t\r\n\f\v";

template <typename Number>
std::optional<Number> parse(std::string_view word) {
  if (word.starts_with('+')) word.remove_prefix(1);
  Number value{};
  const auto [end, failure] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (word.empty() || failure != std::errc() || end != word.data() + word.size()) return std::nullopt;
  return value;
}

}  // namespace

std::string_view trimmed(std::string_view text) {
  const size_t first = text.find_first_not_of(kSpace);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kSpace) - first + 1);
}

Result<std::string> read_text_file(const fs::path& path, uintmax_t max_bytes) try {
  std::error_code failure;
  const fs::file_status status = fs::status(path, failure);
  if (!fs::exists(status)) return bad_input(fmt::format("{}: no such file", path.string()));
  if (!fs::is_regular_file(status)) return bad_input(fmt::format("{}: not a file", path.string()));
  const uintmax_t bytes = fs::file_size(path, failure);
  if (!failure && bytes > max_bytes) {
    return bad_input(fmt::format("{}: {} bytes, at most {} are allowed", path.string(), bytes, max_bytes));
  }
  std::ifstream file(path, std::ios::binary);
  std::string text(failure ? 0 : bytes, '\0');
  if (failure || !file.read(text.data(), static_cast<std::streamsize>(bytes))) {
    return bad_input(fmt::format("{}: cannot be read", path.string()));
  }
  // The mark that some editors put before UTF-8.
  if (text.starts_with("\xef\xbb\xbf")) text.erase(0, 3);
  return text;
} catch (const std::bad_alloc&) {
  return internal_error(fmt::format("{}: not enough memory to read it", path.string()));
}

std::string timestamp_text(double seconds) {
  std::string text = fmt::format("{:.9f}", seconds);
  return parse<double>(text) == seconds ? text : fmt::format("{}", seconds);
}

std::optional<double> parse_number(std::string_view word) {
  return parse<double>(word);
}
std::optional<int64_t> parse_integer(std::string_view word) {
  return parse<int64_t>(word);
}

std::vector<std::string_view> split_words(std::string_view text, std::string_view separators) {
  const std::string ends = std::string(kSpace).append(separators);
  std::vector<std::string_view> words;
  for (size_t begin = text.find_first_not_of(ends); begin != std::string_view::npos;) {
    const size_t end = std::min(text.find_first_of(ends, begin), text.size());
    words.push_back(text.substr(begin, end - begin));
    begin = text.find_first_not_of(ends, end);
  }
  return words;
}

std::string shown(std::string_view text) {
  constexpr size_t kLongest = 40;
  std::string line(text.substr(0, kLongest));
  for (char& c : line) {
    if (static_cast<unsigned char>(c) < ' ' || c == 127) c = '?';
  }
  if (text.size() > kLongest) line += "...";
  return line;
}

std::vector<TextLine> content_lines(std::string_view text) {
  std::vector<TextLine> lines;
  for (int number = 1; !text.empty(); ++number) {
    const std::string_view raw = text.substr(0, text.find('\n'));
    text.remove_prefix(std::min(raw.size() + 1, text.size()));
    const std::string_view line = trimmed(raw);
    if (!line.empty() && line.front() != '#') lines.push_back({number, line});
  }
  return lines;
}

}  // namespace raysfm
