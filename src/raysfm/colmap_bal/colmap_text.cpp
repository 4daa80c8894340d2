#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iterator>
#include <limits>

#include "raysfm/colmap_bal/colmap_format.h"
#include "raysfm/files/text_file.h"
#include "raysfm/files/word_reader.h"

namespace raysfm {
namespace {

// Takes the lines of a text one after another.
class LineReader {
 public:
  explicit LineReader(std::string_view text) : rest_(text) {}

  bool next(std::string_view* line) {
    if (rest_.empty()) return false;
    *line = rest_.substr(0, rest_.find('\n'));
    rest_.remove_prefix(std::min(line->size() + 1, rest_.size()));
    ++number_;
    return true;
  }

  // The next line that is neither blank nor a comment.
  bool next_content(std::string_view* line) {
    while (next(line)) {
      const size_t first = line->find_first_not_of(" \t\r");
      if (first != std::string_view::npos && (*line)[first] != '#') return true;
    }
    return false;
  }

  int number() const { return number_; }

 private:
  std::string_view rest_;
  int number_ = 0;
};

// Takes the words of one line and remembers what the first wrong one was.
class FieldReader {
 public:
  FieldReader(std::string_view line, int number, const std::string& file)
      : words_(line), number_(number), file_(file) {}

  bool fail(const char* field, std::string_view value, const std::string& allowed) {
    message_ =
        fmt::format("{}:{}: {}: '{}' is not allowed, {}", file_, number_, field, shown(value), allowed);
    return false;
  }
  Result<void> error() const { return bad_input(message_); }

  // False at the end of the line, which is no failure.
  bool more(std::string_view* word) { return words_.next(word); }

  bool read(std::string_view* word, const char* field) {
    if (words_.next(word)) return true;
    message_ = fmt::format("{}:{}: the line ends before {}", file_, number_, field);
    return false;
  }

  bool finite(std::string_view word, const char* field, double* value) {
    const std::optional<double> number = parse_number(word);
    if (!number || !std::isfinite(*number)) return fail(field, word, "a finite number is");
    *value = *number;
    return true;
  }
  bool read_finite(const char* field, double* value) {
    std::string_view word;
    return read(&word, field) && finite(word, field, value);
  }
  bool read_number(const char* field, double* value) {
    std::string_view word;
    if (!read(&word, field)) return false;
    const std::optional<double> number = parse_number(word);
    if (!number) return fail(field, word, "a number is");
    *value = *number;
    return true;
  }

  template <typename Integer>
  bool integer(std::string_view word, const char* field, Integer* value) {
    const auto [end, failure] = std::from_chars(word.data(), word.data() + word.size(), *value);
    if (failure == std::errc() && end == word.data() + word.size()) return true;
    return fail(field, word,
                fmt::format("a whole number from 0 to {} is", std::numeric_limits<Integer>::max()));
  }
  template <typename Integer>
  bool read_integer(const char* field, Integer* value) {
    std::string_view word;
    return read(&word, field) && integer(word, field, value);
  }

  // All behind the last word, without white space at its ends.
  std::string_view rest() const {
    constexpr std::string_view kSpace = " \t\r";
    const std::string_view rest = words_.rest();
    const size_t first = rest.find_first_not_of(kSpace);
    if (first == std::string_view::npos) return {};
    return rest.substr(first, rest.find_last_not_of(kSpace) - first + 1);
  }

 private:
  WordReader words_;
  int number_;
  const std::string& file_;
  std::string message_;
};

bool read_camera(FieldReader& fields, ColmapCamera* camera) {
  std::string_view name;
  if (!fields.read_integer("CAMERA_ID", &camera->id) || !fields.read(&name, "MODEL")) return false;
  const ColmapCameraModel* known = find_colmap_model(name);
  if (!known) return fields.fail("MODEL", name, colmap_model_names() + " are");
  camera->model = known->id;
  if (!fields.read_integer("WIDTH", &camera->width) || !fields.read_integer("HEIGHT", &camera->height)) {
    return false;
  }
  camera->parameters.resize(known->parameters);
  for (double& parameter : camera->parameters) {
    if (!fields.read_finite("PARAMS", &parameter)) return false;
  }
  std::string_view more;
  return !fields.more(&more) ||
         fields.fail("PARAMS", more, fmt::format("{} has {} parameters", known->name, known->parameters));
}

bool read_image_line(FieldReader& fields, ColmapImage* image) {
  constexpr const char* kRotation[] = {"QW", "QX", "QY", "QZ"};
  constexpr const char* kTranslation[] = {"TX", "TY", "TZ"};
  if (!fields.read_integer("IMAGE_ID", &image->id)) return false;
  for (size_t i = 0; i < 4; ++i) {
    if (!fields.read_finite(kRotation[i], &image->rotation[i])) return false;
  }
  for (size_t i = 0; i < 3; ++i) {
    if (!fields.read_finite(kTranslation[i], &image->translation[i])) return false;
  }
  if (!fields.read_integer("CAMERA_ID", &image->camera_id)) return false;
  image->name = fields.rest();
  return true;
}

bool read_keypoints(FieldReader& fields, ColmapImage* image, ColmapModel* model) {
  image->first_keypoint = model->keypoints.size();
  for (std::string_view word; fields.more(&word);) {
    ColmapKeypoint& keypoint = model->keypoints.emplace_back();
    std::string_view id;
    if (!fields.finite(word, "X", &keypoint.x) || !fields.read_finite("Y", &keypoint.y) ||
        !fields.read(&id, "POINT3D_ID")) {
      return false;
    }
    if (id != "-1" && !fields.integer(id, "POINT3D_ID", &keypoint.point_id)) return false;
  }
  image->last_keypoint = model->keypoints.size();
  return true;
}

bool read_point(FieldReader& fields, ColmapPoint* point, ColmapModel* model) {
  constexpr const char* kPosition[] = {"X", "Y", "Z"};
  constexpr const char* kColour[] = {"R", "G", "B"};
  if (!fields.read_integer("POINT3D_ID", &point->id)) return false;
  for (int i = 0; i < 3; ++i) {
    if (!fields.read_finite(kPosition[i], &point->position[i])) return false;
  }
  for (size_t i = 0; i < 3; ++i) {
    if (!fields.read_integer(kColour[i], &point->rgb[i])) return false;
  }
  if (!fields.read_number("ERROR", &point->error)) return false;
  point->first_element = model->elements.size();
  for (std::string_view word; fields.more(&word);) {
    ColmapTrackElement& element = model->elements.emplace_back();
    if (!fields.integer(word, "IMAGE_ID", &element.image_id) ||
        !fields.read_integer("POINT2D_IDX", &element.keypoint)) {
      return false;
    }
  }
  point->last_element = model->elements.size();
  return true;
}

}  // namespace

Result<void> parse_colmap_cameras_txt(std::string_view text, const std::string& file, ColmapModel* model) {
  LineReader lines(text);
  for (std::string_view line; lines.next_content(&line);) {
    FieldReader fields(line, lines.number(), file);
    if (!read_camera(fields, &model->cameras.emplace_back())) return fields.error();
  }
  return {};
}

Result<void> parse_colmap_images_txt(std::string_view text, const std::string& file, ColmapModel* model) {
  LineReader lines(text);
  for (std::string_view line; lines.next_content(&line);) {
    FieldReader header(line, lines.number(), file);
    ColmapImage& image = model->images.emplace_back();
    if (!read_image_line(header, &image)) return header.error();
    if (!lines.next(&line)) {
      return bad_input(
          fmt::format("{}:{}: the line with the keypoints of image {} is missing behind this one, "
                      "it may be empty",
                      file, lines.number(), image.id));
    }
    FieldReader keypoints(line, lines.number(), file);
    if (!read_keypoints(keypoints, &image, model)) return keypoints.error();
  }
  return {};
}

Result<void> parse_colmap_points_txt(std::string_view text, const std::string& file, ColmapModel* model) {
  LineReader lines(text);
  for (std::string_view line; lines.next_content(&line);) {
    FieldReader fields(line, lines.number(), file);
    if (!read_point(fields, &model->points.emplace_back(), model)) return fields.error();
  }
  return {};
}

std::string format_colmap_cameras_txt(const ColmapModel& model) {
  std::string text = fmt::format(
      "# Camera list with one line of data per camera:\n"
      "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
      "# Number of cameras: {}\n",
      model.cameras.size());
  const auto out = std::back_inserter(text);
  for (const ColmapCamera& camera : model.cameras) {
    fmt::format_to(out, "{} {} {} {}", camera.id, find_colmap_model(camera.model)->name, camera.width,
                   camera.height);
    for (const double parameter : camera.parameters) fmt::format_to(out, " {:.17g}", parameter);
    text += '\n';
  }
  return text;
}

std::string format_colmap_images_txt(const ColmapModel& model) {
  std::string text = fmt::format(
      "# Image list with two lines of data per image:\n"
      "#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n"
      "#   POINTS2D[] as (X, Y, POINT3D_ID)\n"
      "# Number of images: {}\n",
      model.images.size());
  const auto out = std::back_inserter(text);
  for (const ColmapImage& image : model.images) {
    fmt::format_to(out, "{}", image.id);
    for (const double q : image.rotation) fmt::format_to(out, " {:.17g}", q);
    for (const double t : image.translation) fmt::format_to(out, " {:.17g}", t);
    fmt::format_to(out, " {} {}\n", image.camera_id, image.name);
    for (size_t i = image.first_keypoint; i < image.last_keypoint; ++i) {
      const ColmapKeypoint& k = model.keypoints[i];
      fmt::format_to(out, "{}{:.17g} {:.17g} ", i > image.first_keypoint ? " " : "", k.x, k.y);
      k.point_id == kNoColmapPoint ? fmt::format_to(out, "-1") : fmt::format_to(out, "{}", k.point_id);
    }
    text += '\n';
  }
  return text;
}

std::string format_colmap_points_txt(const ColmapModel& model) {
  std::string text = fmt::format(
      "# 3D point list with one line of data per point:\n"
      "#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n"
      "# Number of points: {}\n",
      model.points.size());
  const auto out = std::back_inserter(text);
  for (const ColmapPoint& point : model.points) {
    fmt::format_to(out, "{}", point.id);
    for (const double x : point.position) fmt::format_to(out, " {:.17g}", x);
    for (const uint8_t channel : point.rgb) fmt::format_to(out, " {}", channel);
    fmt::format_to(out, " {:.17g}", point.error);
    for (size_t i = point.first_element; i < point.last_element; ++i) {
      fmt::format_to(out, " {} {}", model.elements[i].image_id, model.elements[i].keypoint);
    }
    text += '\n';
  }
  return text;
}

}  // namespace raysfm
