#include "raysfm/frames/image_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <optional>
#include <system_error>
#include <utility>

#include "raysfm/frames/image_file.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;

bool is_digit(char c) {
  return c >= '0' && c <= '9';
}

class ImageSource : public FrameSource {
 public:
  // `first`: the first image that can be decoded, `first_index` its place among the files.
  ImageSource(std::string what, std::vector<fs::path> files, std::vector<double> timestamps,
              size_t first_index, DecodedImage first)
      : what_(std::move(what)),
        files_(std::move(files)),
        timestamps_(std::move(timestamps)),
        width_(first.gray.width()),
        height_(first.gray.height()),
        first_index_(first_index),
        first_name_(files_[first_index].filename().string()),
        first_(std::move(first)) {}

  Result<std::optional<InputFrame>> next() override {
    if (index_ >= files_.size()) return std::optional<InputFrame>();
    const size_t index = index_++;
    Result<DecodedImage> image = decode(index);
    if (!image && image.error().kind != ErrorKind::kBadInput) {
      index_ = files_.size();
      return image.error();
    }
    InputFrame frame;
    frame.index = static_cast<int>(index);
    frame.timestamp = timestamps_[index];
    frame.name = files_[index].filename().string();
    frame.file = files_[index];
    frame.defect = image ? odd_size(index, image->gray) : image.error().message;
    if (frame.defect.empty()) {
      frame.gray = std::move(image->gray);
      frame.colors = std::move(image->colors);
    }
    return std::optional<InputFrame>(std::move(frame));
  }

  int width() const override { return width_; }
  int height() const override { return height_; }
  int frame_count() const override { return static_cast<int>(files_.size()); }
  TimeRange span() const override { return {timestamps_.front(), timestamps_.back()}; }
  void allow_any_size() override { any_size_ = true; }

  Result<void> cut(const TimeRange& range) override {
    const auto begin = std::ranges::lower_bound(timestamps_, range.from);
    const auto end = range.to > 0 ? std::ranges::upper_bound(timestamps_, range.to) : timestamps_.end();
    if (begin >= end) return no_frames_in(range, what_);
    const auto first = begin - timestamps_.begin(), last = end - timestamps_.begin();
    files_ = {files_.begin() + first, files_.begin() + last};
    timestamps_ = {begin, end};
    first_.reset();  // it gave the size
    return {};
  }

  std::string description() const override {
    return fmt::format("{}: {} images, {}x{}", what_, files_.size(), width_, height_);
  }

 private:
  Result<DecodedImage> decode(size_t index) {
    if (index == first_index_ && first_) return *std::exchange(first_, std::nullopt);
    return read_image(files_[index]);
  }
  std::string odd_size(size_t index, const GrayImage& image) const {
    if (any_size_ || (image.width() == width_ && image.height() == height_)) return {};
    return fmt::format("{}: {} x {} pixels; allowed: the {} x {} of the first, {}", files_[index].string(),
                       image.width(), image.height(), width_, height_, first_name_);
  }

  std::string what_;
  std::vector<fs::path> files_;
  std::vector<double> timestamps_;
  int width_, height_;
  bool any_size_ = false;
  size_t first_index_;
  std::string first_name_;
  std::optional<DecodedImage> first_;
  size_t index_ = 0;
};

bool has_image_extension(const fs::path& path) {
  constexpr std::string_view kExtensions[] = {".png",  ".jpg", ".jpeg", ".bmp", ".tif",
                                              ".tiff", ".pgm", ".ppm",  ".pnm", ".webp"};
  std::string extension = path.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return std::find(std::begin(kExtensions), std::end(kExtensions), extension) != std::end(kExtensions);
}

// Regular files of a folder, without hidden ones, in natural order.
Result<std::vector<fs::path>> list_files(const fs::path& folder) {
  std::error_code failure;
  std::vector<fs::path> files;
  for (fs::directory_iterator it(folder, failure), end; !failure && it != end; it.increment(failure)) {
    std::error_code ignored;
    if (it->is_regular_file(ignored) && !it->path().filename().string().starts_with('.'))
      files.push_back(it->path());
  }
  if (failure)
    return bad_input(fmt::format("{}: the folder cannot be read: {}", folder.string(), failure.message()));
  std::sort(files.begin(), files.end(), [](const fs::path& a, const fs::path& b) {
    return natural_less(a.filename().string(), b.filename().string());
  });
  return files;
}

// One %d, %4d or %04d of a pattern becomes "*" between digits: its prefix, suffix and least number of digits.
struct NumberPattern {
  std::string_view prefix, suffix;
  size_t digits;
};

std::optional<NumberPattern> number_pattern(std::string_view pattern) {
  const size_t percent = pattern.find('%');
  if (percent == std::string_view::npos) return std::nullopt;
  size_t end = percent + 1;
  size_t digits = 0;
  for (; end < pattern.size() && is_digit(pattern[end]) && digits < 100; ++end)
    digits = digits * 10 + (pattern[end] - '0');
  if (end >= pattern.size() || pattern[end] != 'd') return std::nullopt;
  return NumberPattern{pattern.substr(0, percent), pattern.substr(end + 1), std::max<size_t>(digits, 1)};
}

bool matches(const NumberPattern& pattern, std::string_view name) {
  if (!name.starts_with(pattern.prefix)) return false;
  name.remove_prefix(pattern.prefix.size());
  if (!name.ends_with(pattern.suffix)) return false;
  name.remove_suffix(pattern.suffix.size());
  return name.size() >= pattern.digits && std::all_of(name.begin(), name.end(), is_digit);
}

// * and ?; on a mismatch the last star takes one character more, so the cost is at most the product of the
// lengths.
bool matches(std::string_view pattern, std::string_view name) {
  size_t p = 0, n = 0, star = std::string_view::npos, star_n = 0;
  while (n < name.size()) {
    if (p < pattern.size() && pattern[p] == '*') {
      star = p++;
      star_n = n;
    } else if (p < pattern.size() && (pattern[p] == '?' || pattern[p] == name[n])) {
      ++p;
      ++n;
    } else if (star != std::string_view::npos) {
      p = star + 1;
      n = ++star_n;
    } else {
      return false;
    }
  }
  return pattern.find_first_not_of('*', p) == std::string_view::npos;
}

}  // namespace

Result<std::unique_ptr<FrameSource>> open_images(std::string what, std::vector<fs::path> files,
                                                 std::vector<double> timestamps) {
  if (files.empty())
    return bad_input(what + ": no image; allowed: at least one PNG, JPEG, BMP, TIFF, PNM or WebP");
  for (const fs::path& file : files) {
    std::error_code failure;
    if (!fs::is_regular_file(file, failure))
      return bad_input(file.string() + ": no such file; allowed: an image");
  }
  std::optional<Error> damaged;
  for (size_t i = 0; i < files.size(); ++i) {
    Result<DecodedImage> first = read_image(files[i]);
    if (first) {
      return std::unique_ptr<FrameSource>(std::make_unique<ImageSource>(
          std::move(what), std::move(files), std::move(timestamps), i, std::move(*first)));
    }
    if (!damaged) damaged = first.error();
  }
  return *damaged;
}

std::vector<double> index_timestamps(size_t count, double fps) {
  std::vector<double> timestamps(count);
  for (size_t i = 0; i < count; ++i)
    timestamps[i] = fps > 0 ? static_cast<double>(i) / fps : static_cast<double>(i);
  return timestamps;
}

bool natural_less(std::string_view a, std::string_view b) {
  size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (!is_digit(a[i]) || !is_digit(b[j])) {
      if (a[i] != b[j]) return static_cast<unsigned char>(a[i]) < static_cast<unsigned char>(b[j]);
      ++i;
      ++j;
      continue;
    }
    const auto run = [](std::string_view s, size_t* at) {
      while (*at < s.size() && s[*at] == '0') ++*at;
      const size_t begin = *at;
      while (*at < s.size() && is_digit(s[*at])) ++*at;
      return s.substr(begin, *at - begin);
    };
    const std::string_view x = run(a, &i), y = run(b, &j);
    if (x.size() != y.size()) return x.size() < y.size();
    if (x != y) return x < y;
  }
  if (i < a.size() || j < b.size()) return j < b.size();
  return a < b;  // "7" and "007"
}

Result<std::vector<fs::path>> list_images(const fs::path& folder) {
  Result<std::vector<fs::path>> files = list_files(folder);
  if (!files) return files;
  std::erase_if(*files, [](const fs::path& file) {
    return file.filename() == "mask.png" || !(has_image_extension(file) || is_image_file(file));
  });
  return files;
}

Result<std::vector<fs::path>> match_images(const fs::path& pattern) {
  const fs::path folder = pattern.has_parent_path() ? pattern.parent_path() : fs::path(".");
  Result<std::vector<fs::path>> files = list_files(folder);
  if (!files) return files;
  const std::string name = pattern.filename().string();
  const std::optional<NumberPattern> numbered = number_pattern(name);
  std::erase_if(*files, [&](const fs::path& file) {
    const std::string candidate = file.filename().string();
    return !(numbered ? matches(*numbered, candidate) : matches(std::string_view(name), candidate));
  });
  if (files->empty()) return bad_input(fmt::format("{}: no file matches the pattern", pattern.string()));
  return files;
}

}  // namespace raysfm
