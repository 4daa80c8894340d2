#include "raysfm/colmap_bal/bal_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <new>
#include <optional>

#include "raysfm/files/atomic_file.h"
#include "raysfm/files/bzip2.h"
#include "raysfm/files/text_file.h"
#include "raysfm/files/word_reader.h"

namespace raysfm {
namespace {

constexpr uintmax_t kMaxTextBytes = uintmax_t{8} << 30;
// Text of numbers packs to a quarter. A file that unpacks to far more was made to exhaust its reader.
constexpr uintmax_t kMaxPacking = 100;
constexpr uintmax_t kAlwaysAllowed = 1 << 20;

// The shortest text of each, with the space between: "0 0 0 0 ".
constexpr uint64_t kBalObservationBytes = 8, kBalCameraBytes = 18, kBalPointBytes = 6;

// What a number may be: at most `most` from 0, and above 0 where it must be.
struct Range {
  double most;
  bool positive = false;

  bool holds(double value) const { return std::abs(value) <= most && (!positive || value > 0); }
  std::string text() const {
    return positive ? fmt::format("a number above 0, up to {:g}", most)
                    : fmt::format("a number from {:g} to {:g}", -most, most);
  }
};

// One of the numbers of a camera or a point.
struct BlockField {
  const char* name;
  Range range;
};

constexpr Range kBalPixel{kMaxBalPixel}, kBalAngle{kMaxBalAngle}, kBalCoordinate{kMaxBalCoordinate},
    kBalFocal{kMaxBalFocal, true}, kBalDistortion{kMaxBalDistortion};
constexpr std::array<BlockField, 9> kBalCameraFields = {{{"rotation x", kBalAngle},
                                                         {"rotation y", kBalAngle},
                                                         {"rotation z", kBalAngle},
                                                         {"translation x", kBalCoordinate},
                                                         {"translation y", kBalCoordinate},
                                                         {"translation z", kBalCoordinate},
                                                         {"f", kBalFocal},
                                                         {"k1", kBalDistortion},
                                                         {"k2", kBalDistortion}}};
constexpr std::array<BlockField, 3> kBalPointFields = {
    {{"x", kBalCoordinate}, {"y", kBalCoordinate}, {"z", kBalCoordinate}}};

class BalParser {
 public:
  BalParser(std::string_view text, const std::string& name) : words_(text), name_(name) {}

  Result<BalFile> parse() {
    if (!counts() || !observations() || !blocks("camera", kBalCameraFields, &file_.cameras) ||
        !blocks("point", kBalPointFields, &file_.points) || !end()) {
      return bad_input(std::move(message_));
    }
    return std::move(file_);
  }

 private:
  bool fail(const std::string& what) {
    message_ = fmt::format("{}:{}: {}", name_, words_.line(), what);
    return false;
  }

  // `where` makes the name of the field, only when it is needed.
  template <typename Where>
  bool word(const Where& where, std::string_view* word) {
    return words_.next(word) || fail(fmt::format("the file ends before {}", where()));
  }

  template <typename Where>
  bool number(const Where& where, const Range& range, double* value) {
    std::string_view text;
    if (!word(where, &text)) return false;
    const std::optional<double> parsed = parse_number(text);
    if (!parsed || !range.holds(*parsed)) {
      return fail(fmt::format("{}: '{}' is not allowed, {} is", where(), shown(text), range.text()));
    }
    *value = *parsed;
    return true;
  }

  // An integer in [0, limit).
  template <typename Where>
  bool integer(const Where& where, int64_t limit, int* value) {
    std::string_view text;
    if (!word(where, &text)) return false;
    const std::optional<int64_t> parsed = parse_integer(text);
    if (!parsed || *parsed < 0 || *parsed >= limit) {
      return fail(fmt::format("{}: '{}' is not allowed, a whole number from 0 to {} is", where(), shown(text),
                              limit - 1));
    }
    *value = static_cast<int>(*parsed);
    return true;
  }

  bool counts() {
    constexpr int64_t kLimit = std::numeric_limits<int>::max();
    int cameras = 0, points = 0, observations = 0;
    if (!integer([] { return "number of cameras"; }, kLimit, &cameras) ||
        !integer([] { return "number of points"; }, kLimit, &points) ||
        !integer([] { return "number of observations"; }, kLimit, &observations)) {
      return false;
    }
    const uint64_t least = kBalObservationBytes * observations + kBalCameraBytes * cameras +
                           kBalPointBytes * points;  // below 2^37
    if (least > words_.rest().size()) {
      return fail(
          fmt::format("{} cameras, {} points and {} observations are not allowed, they need at least {} "
                      "bytes and {} follow",
                      cameras, points, observations, least, words_.rest().size()));
    }
    file_.cameras.resize(cameras);
    file_.points.resize(points);
    file_.observations.resize(observations);
    return true;
  }

  bool observations() {
    const auto cameras = static_cast<int64_t>(file_.cameras.size());
    const auto points = static_cast<int64_t>(file_.points.size());
    for (size_t i = 0; i < file_.observations.size(); ++i) {
      const auto field = [i](const char* name) {
        return [i, name] { return fmt::format("observation {}: {}", i, name); };
      };
      BalObservation& o = file_.observations[i];
      if (!integer(field("camera"), cameras, &o.camera) || !integer(field("point"), points, &o.point) ||
          !number(field("x"), kBalPixel, &o.pixel[0]) || !number(field("y"), kBalPixel, &o.pixel[1])) {
        return false;
      }
    }
    return true;
  }

  template <size_t N, typename Block>
  bool blocks(const char* kind, const std::array<BlockField, N>& fields, std::vector<Block>* all) {
    for (size_t i = 0; i < all->size(); ++i) {
      for (size_t k = 0; k < N; ++k) {
        const auto where = [&] { return fmt::format("{} {}: {}", kind, i, fields[k].name); };
        if (!number(where, fields[k].range, &(*all)[i][k])) return false;
      }
    }
    return true;
  }

  bool end() {
    std::string_view text;
    return !words_.next(&text) ||
           fail(fmt::format("'{}' is not allowed, the file ends after the last point", shown(text)));
  }

  WordReader words_;
  const std::string& name_;
  BalFile file_;
  std::string message_;
};

}  // namespace

Result<BalFile> parse_bal(std::string_view text, const std::string& name) {
  return BalParser(text, name).parse();
}

std::string format_bal(const BalFile& file) {
  std::string text;
  const auto out = std::back_inserter(text);
  fmt::format_to(out, "{} {} {}\n", file.cameras.size(), file.points.size(), file.observations.size());
  for (const BalObservation& o : file.observations) {
    fmt::format_to(out, "{} {} {:.17g} {:.17g}\n", o.camera, o.point, o.pixel.x(), o.pixel.y());
  }
  for (const auto& camera : file.cameras) {
    for (const double number : camera) fmt::format_to(out, "{:.17g}\n", number);
  }
  for (const Eigen::Vector3d& point : file.points) {
    for (const double number : point) fmt::format_to(out, "{:.17g}\n", number);
  }
  return text;
}

Result<BalFile> read_bal_file(const std::filesystem::path& path) try {
  Result<std::string> text = read_text_file(path, kMaxTextBytes);
  if (!text) return text.error();
  const bool compressed = is_bzip2(*text);
  if (compressed) {
    const uintmax_t most = std::min<uintmax_t>(kMaxTextBytes, kMaxPacking * text->size() + kAlwaysAllowed);
    text = decompress_bzip2(*text, most);
    if (!text) return Error{text.error().kind, fmt::format("{}: {}", path.string(), text.error().message)};
  }
  Result<BalFile> file = parse_bal(*text, path.string());
  if (file) file->compressed = compressed;
  return file;
} catch (const std::bad_alloc&) {
  return internal_error(fmt::format("{}: not enough memory to read it", path.string()));
}

Result<void> write_bal_file(const BalFile& file, const std::filesystem::path& path) {
  const std::string text = format_bal(file);
  return write_file(path, file.compressed ? compress_bzip2(text) : text);
}

}  // namespace raysfm
