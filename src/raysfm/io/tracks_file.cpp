#include "raysfm/io/tracks_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <limits>
#include <numeric>
#include <optional>
#include <unordered_map>

#include "raysfm/io/text_file.h"

namespace raysfm {
namespace {

constexpr uintmax_t kMaxBytes = uintmax_t{2} << 30;
constexpr double kMaxPixel = 1e6;
constexpr std::string_view kHeader = "image,point,u,v";

std::string_view trimmed(std::string_view text) {
  const size_t first = text.find_first_not_of(" \t\r"), last = text.find_last_not_of(" \t\r");
  return first == std::string_view::npos ? std::string_view() : text.substr(first, last - first + 1);
}

// The four fields of a line; false where there are more or fewer.
bool split_fields(std::string_view line, std::array<std::string_view, 4>* fields) {
  for (size_t i = 0; i < 4; ++i) {
    const size_t comma = line.find(',');
    if ((comma == std::string_view::npos) != (i == 3)) return false;
    (*fields)[i] = trimmed(line.substr(0, comma));
    if (i < 3) line.remove_prefix(comma + 1);
  }
  return true;
}

bool is_header(std::string_view line) {
  std::string plain;
  for (const char c : line) {
    if (c != ' ' && c != '\t') plain += c;
  }
  return plain == kHeader;
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

Result<Eigen::Vector2d> parse_pixel(std::string_view u, std::string_view v, const std::string& where) {
  Eigen::Vector2d pixel;
  const std::pair<const char*, std::string_view> fields[] = {{"u", u}, {"v", v}};
  for (int i = 0; i < 2; ++i) {
    const std::optional<double> value = parse_number(fields[i].second);
    if (!value || !(std::abs(*value) <= kMaxPixel)) {
      return bad_input(fmt::format("{}: {} = '{}' is not allowed, a number from {} to {} is", where,
                                   fields[i].first, shown(fields[i].second), -kMaxPixel, kMaxPixel));
    }
    pixel[i] = *value;
  }
  return pixel;
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
  const Result<std::string> text = read_text_file(path, kMaxBytes);
  if (!text) return text.error();
  const std::vector<TextLine> lines = content_lines(*text);
  if (lines.empty() || !is_header(lines[0].text)) {
    return bad_input(fmt::format("{}:{}: '{}' is not allowed, the header line {} is", path.string(),
                                 lines.empty() ? 1 : lines[0].number,
                                 lines.empty() ? "" : shown(lines[0].text), kHeader));
  }
  TracksFile file;
  Names images, points;
  for (size_t i = 1; i < lines.size(); ++i) {
    const std::string where = fmt::format("{}:{}", path.string(), lines[i].number);
    std::array<std::string_view, 4> fields;
    if (!split_fields(lines[i].text, &fields) || fields[0].empty() || fields[1].empty()) {
      return bad_input(
          fmt::format("{}: '{}' is not allowed, four fields are: {}", where, shown(lines[i].text), kHeader));
    }
    const Result<Eigen::Vector2d> pixel = parse_pixel(fields[2], fields[3], where);
    if (!pixel) return pixel.error();
    file.image.push_back(images.number_of(fields[0]));
    file.point.push_back(points.number_of(fields[1]));
    file.pixel.push_back(*pixel);
  }
  file.images = std::move(images.names());
  file.points = std::move(points.names());
  if (const int k = find_duplicate(file); k >= 0) {
    return bad_input(fmt::format("{}:{}: point '{}' is seen in image '{}' a second time, once is allowed",
                                 path.string(), lines[k + 1].number, shown(file.points[file.point[k]]),
                                 shown(file.images[file.image[k]])));
  }
  put_images_in_order(&file);
  return file;
}

}  // namespace raysfm
