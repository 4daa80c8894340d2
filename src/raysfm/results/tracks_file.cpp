#include "raysfm/results/tracks_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <limits>
#include <numeric>
#include <optional>
#include <unordered_map>

#include "raysfm/files/text_file.h"

namespace raysfm {
namespace {

constexpr uintmax_t kMaxTracksBytes = uintmax_t{2} << 30;
constexpr double kMaxPixel = 1e6;
constexpr double kMaxPosition = 1e9;
constexpr std::string_view kHeader = "image,point,u,v";
constexpr std::string_view kStructureHeader = "point,x,y,z";

// A line behind the header and its four fields.
struct Row {
  int line = 0;
  std::string where;  // file and line
  std::array<std::string_view, 4> fields;
};

// False where there are more or fewer fields.
bool split_fields(std::string_view line, std::array<std::string_view, 4>* fields) {
  for (size_t i = 0; i < 4; ++i) {
    const size_t comma = line.find(',');
    if ((comma == std::string_view::npos) != (i == 3)) return false;
    (*fields)[i] = trimmed(line.substr(0, comma));
    if (i < 3) line.remove_prefix(comma + 1);
  }
  return true;
}

bool is_header(std::string_view line, std::string_view header) {
  std::string plain;
  for (const char c : line) {
    if (c != ' ' && c != '\t') plain += c;
  }
  return plain == header;
}

// Calls `take` with every row behind the header until it complains; the first `names` fields are not empty.
template <typename Take>
Result<void> read_rows(const std::filesystem::path& path, const std::string& text, std::string_view header,
                       int names, Take take) {
  const std::vector<TextLine> lines = content_lines(text);
  if (lines.empty() || !is_header(lines[0].text, header)) {
    return bad_input(fmt::format("{}:{}: '{}' is not allowed, the header line {} is", path.string(),
                                 lines.empty() ? 1 : lines[0].number,
                                 lines.empty() ? "" : shown(lines[0].text), header));
  }
  Row row;
  for (size_t i = 1; i < lines.size(); ++i) {
    row.line = lines[i].number;
    row.where = fmt::format("{}:{}", path.string(), lines[i].number);
    const bool split = split_fields(lines[i].text, &row.fields);
    if (!split || std::any_of(row.fields.begin(), row.fields.begin() + names,
                              [](std::string_view field) { return field.empty(); })) {
      return bad_input(fmt::format("{}: '{}' is not allowed, four fields are: {}", row.where,
                                   shown(lines[i].text), header));
    }
    if (auto taken = take(row); !taken) return taken;
  }
  return {};
}

// Numbers of names, in order of appearance.
class Names {
 public:
  int number_of(std::string_view name) {
    const auto [place, added] = numbers_.try_emplace(name, static_cast<int>(names_.size()));
    if (added) names_.emplace_back(name);
    return place->second;
  }
  std::vector<std::string>& names() { return names_; }

 private:
  std::unordered_map<std::string_view, int> numbers_;
  std::vector<std::string> names_;
};

// Their values, where all are different whole numbers.
std::optional<std::vector<int64_t>> whole_numbers(const std::vector<std::string>& names) {
  constexpr int64_t kExact = int64_t{1} << 53;  // as a timestamp
  std::vector<int64_t> values;
  for (const std::string& name : names) {
    const std::optional<int64_t> value = parse_integer(name);
    if (!value || *value < -kExact || *value > kExact) return std::nullopt;
    values.push_back(*value);
  }
  std::vector<int64_t> sorted = values;
  std::ranges::sort(sorted);
  if (std::ranges::adjacent_find(sorted) != sorted.end()) return std::nullopt;
  return values;
}

void put_images_in_order(TracksFile* file) {
  const std::optional<std::vector<int64_t>> values = whole_numbers(file->images);
  std::vector<int> order(file->images.size()), place(file->images.size());
  std::iota(order.begin(), order.end(), 0);
  std::ranges::sort(order, [&](int a, int b) {
    return values ? (*values)[a] < (*values)[b] : file->images[a] < file->images[b];
  });
  std::vector<std::string> names;
  for (size_t i = 0; i < order.size(); ++i) {
    place[order[i]] = static_cast<int>(i);
    names.push_back(std::move(file->images[order[i]]));
    file->timestamps.push_back(values ? static_cast<double>((*values)[order[i]]) : static_cast<double>(i));
  }
  file->images = std::move(names);
  for (int& image : file->image) image = place[image];
}

// Of an (image, point) that occurs before: the later observation; -1 where all are different.
int find_duplicate(const TracksFile& file) {
  std::vector<int> order(file.image.size());
  std::iota(order.begin(), order.end(), 0);
  const auto key = [&](int k) { return std::tuple(file.image[k], file.point[k], k); };
  std::ranges::sort(order, {}, key);
  int duplicate = -1;
  for (size_t i = 1; i < order.size(); ++i) {
    const int a = order[i - 1], b = order[i];
    if (file.image[a] != file.image[b] || file.point[a] != file.point[b]) continue;
    if (duplicate < 0 || b < duplicate) duplicate = b;
  }
  return duplicate;
}

// The last N fields of a row, finite and at most `largest` to either side.
template <int N>
Result<Eigen::Matrix<double, N, 1>> parse_numbers(const Row& row, const std::array<const char*, N>& names,
                                                  double largest) {
  Eigen::Matrix<double, N, 1> numbers;
  for (int i = 0; i < N; ++i) {
    const std::string_view field = row.fields[4 - N + i];
    const std::optional<double> value = parse_number(field);
    if (!value || !(std::abs(*value) <= largest)) {
      return bad_input(fmt::format("{}: {} = '{}' is not allowed, a number from {} to {} is", row.where,
                                   names[i], shown(field), -largest, largest));
    }
    numbers[i] = *value;
  }
  return numbers;
}

}  // namespace

bool is_tracks_file(const std::filesystem::path& path) {
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(path, ignored)) return false;
  if (path.extension() == ".csv") return true;
  std::ifstream file(path, std::ios::binary);
  std::string start(kHeader.size(), '\0');
  return file.read(start.data(), static_cast<std::streamsize>(start.size())) && start == kHeader;
}

Result<TracksFile> read_tracks_file(const std::filesystem::path& path) {
  const Result<std::string> text = read_text_file(path, kMaxTracksBytes);
  if (!text) return text.error();
  TracksFile file;
  Names images, points;
  std::vector<int> lines;
  const auto read = read_rows(path, *text, kHeader, 2, [&](const Row& row) -> Result<void> {
    const auto pixel = parse_numbers<2>(row, {"u", "v"}, kMaxPixel);
    if (!pixel) return pixel.error();
    file.image.push_back(images.number_of(row.fields[0]));
    file.point.push_back(points.number_of(row.fields[1]));
    file.pixel.push_back(*pixel);
    lines.push_back(row.line);
    return {};
  });
  if (!read) return read.error();
  file.images = std::move(images.names());
  file.points = std::move(points.names());
  if (const int k = find_duplicate(file); k >= 0) {
    return bad_input(fmt::format("{}:{}: point '{}' is seen in image '{}' a second time, once is allowed",
                                 path.string(), lines[k], shown(file.points[file.point[k]]),
                                 shown(file.images[file.image[k]])));
  }
  put_images_in_order(&file);
  return file;
}

Result<StructureFile> read_structure_file(const std::filesystem::path& path) {
  const Result<std::string> text = read_text_file(path, kMaxTracksBytes);
  if (!text) return text.error();
  StructureFile file;
  Names points;
  const auto read = read_rows(path, *text, kStructureHeader, 1, [&](const Row& row) -> Result<void> {
    const auto position = parse_numbers<3>(row, {"x", "y", "z"}, kMaxPosition);
    if (!position) return position.error();
    if (points.number_of(row.fields[0]) < static_cast<int>(file.positions.size())) {
      return bad_input(fmt::format("{}: point '{}' is there a second time, once is allowed", row.where,
                                   shown(row.fields[0])));
    }
    file.positions.push_back(*position);
    return {};
  });
  if (!read) return read.error();
  file.points = std::move(points.names());
  return file;
}

}  // namespace raysfm
