#include <fmt/format.h>

#include <cmath>
#include <cstring>
#include <type_traits>

#include "raysfm/colmap_bal/colmap_format.h"
#include "raysfm/files/little_endian.h"

namespace raysfm {
namespace {

// The least that a record of each kind takes, in bytes.
constexpr uint64_t kCameraBytes = 24, kImageBytes = 73, kKeypointBytes = 24, kPointBytes = 51,
                   kElementBytes = 8;

// Reads records from bytes and remembers what the first wrong one was.
class RecordReader {
 public:
  RecordReader(std::string_view bytes, const std::string& file) : bytes_(bytes), file_(file) {}

  bool fail(const std::string& field, const std::string& value, const std::string& allowed) {
    message_ = fmt::format("{}: {}: {} is not allowed, {}", file_, field, value, allowed);
    return false;
  }
  Result<void> error() const { return bad_input(message_); }

  template <typename Number>
  bool read(Number* value, const char* kind, uint64_t record) {
    static_assert(std::is_arithmetic_v<Number>);
    if (bytes_.size() < sizeof(Number)) return cut_off(kind, record);
    std::memcpy(value, bytes_.data(), sizeof(Number));  // little endian, as little_endian.h makes sure of
    bytes_.remove_prefix(sizeof(Number));
    return true;
  }

  bool read_finite(double* value, const char* kind, uint64_t record, const char* field) {
    if (!read(value, kind, record)) return false;
    return std::isfinite(*value) || fail(fmt::format("{} {}: {}", kind, record, field),
                                         fmt::format("{}", *value), "a finite number is");
  }

  // Text up to a zero byte.
  bool read_name(std::string* name, const char* kind, uint64_t record) {
    const size_t length = bytes_.find('\0');
    if (length == std::string_view::npos) return cut_off(kind, record);
    *name = bytes_.substr(0, length);
    bytes_.remove_prefix(length + 1);
    return true;
  }

  // A number of records of at least `least_bytes` each, which must fit into what is left of the file.
  bool read_count(uint64_t* count, uint64_t least_bytes, const std::string& field) {
    if (bytes_.size() < sizeof(*count)) {
      message_ = fmt::format("{}: the file ends before the {}", file_, field);
      return false;
    }
    std::memcpy(count, bytes_.data(), sizeof(*count));
    bytes_.remove_prefix(sizeof(*count));
    const uint64_t most = bytes_.size() / least_bytes;
    return *count <= most ||
           fail(field, fmt::format("{}", *count),
                fmt::format("at most {} fit into the {} bytes that follow", most, bytes_.size()));
  }

  Result<void> end(const char* kind) const {
    if (bytes_.empty()) return {};
    return bad_input(fmt::format("{}: {} bytes behind the last {} are not allowed, the file ends there",
                                 file_, bytes_.size(), kind));
  }

 private:
  bool cut_off(const char* kind, uint64_t record) {
    message_ = fmt::format("{}: the file ends within {} {}", file_, kind, record);
    return false;
  }

  std::string_view bytes_;
  const std::string& file_;
  std::string message_;
};

bool read_camera(RecordReader& reader, uint64_t record, ColmapCamera* camera) {
  if (!reader.read(&camera->id, "camera", record) || !reader.read(&camera->model, "camera", record))
    return false;
  const ColmapCameraModel* known = find_colmap_model(camera->model);
  if (!known) {
    return reader.fail(fmt::format("camera {}: model", camera->id), fmt::format("{}", camera->model),
                       "0 to 17 are");
  }
  if (!reader.read(&camera->width, "camera", record) || !reader.read(&camera->height, "camera", record)) {
    return false;
  }
  camera->parameters.resize(known->parameters);
  for (double& parameter : camera->parameters) {
    if (!reader.read_finite(&parameter, "camera", record, "parameter")) return false;
  }
  return true;
}

bool read_image_record(RecordReader& reader, uint64_t record, ColmapImage* image, ColmapModel* model) {
  if (!reader.read(&image->id, "image", record)) return false;
  for (double& q : image->rotation) {
    if (!reader.read_finite(&q, "image", record, "rotation")) return false;
  }
  for (double& t : image->translation) {
    if (!reader.read_finite(&t, "image", record, "translation")) return false;
  }
  uint64_t count = 0;
  if (!reader.read(&image->camera_id, "image", record) || !reader.read_name(&image->name, "image", record) ||
      !reader.read_count(&count, kKeypointBytes, fmt::format("number of keypoints of image {}", record))) {
    return false;
  }
  image->first_keypoint = model->keypoints.size();
  for (uint64_t i = 0; i < count; ++i) {
    ColmapKeypoint& keypoint = model->keypoints.emplace_back();
    if (!reader.read_finite(&keypoint.x, "image", record, "x") ||
        !reader.read_finite(&keypoint.y, "image", record, "y") ||
        !reader.read(&keypoint.point_id, "image", record)) {
      return false;
    }
  }
  image->last_keypoint = model->keypoints.size();
  return true;
}

bool read_point(RecordReader& reader, uint64_t record, ColmapPoint* point, ColmapModel* model) {
  if (!reader.read(&point->id, "point", record)) return false;
  for (double& x : point->position) {
    if (!reader.read_finite(&x, "point", record, "position")) return false;
  }
  for (uint8_t& channel : point->rgb) {
    if (!reader.read(&channel, "point", record)) return false;
  }
  uint64_t count = 0;
  if (!reader.read(&point->error, "point", record) ||
      !reader.read_count(&count, kElementBytes, fmt::format("length of the track of point {}", record))) {
    return false;
  }
  point->first_element = model->elements.size();
  for (uint64_t i = 0; i < count; ++i) {
    ColmapTrackElement& element = model->elements.emplace_back();
    if (!reader.read(&element.image_id, "point", record) ||
        !reader.read(&element.keypoint, "point", record)) {
      return false;
    }
  }
  point->last_element = model->elements.size();
  return true;
}

}  // namespace

Result<void> parse_colmap_cameras_bin(std::string_view bytes, const std::string& file, ColmapModel* model) {
  RecordReader reader(bytes, file);
  uint64_t count = 0;
  if (!reader.read_count(&count, kCameraBytes, "number of cameras")) return reader.error();
  model->cameras.reserve(count);
  for (uint64_t i = 1; i <= count; ++i) {
    if (!read_camera(reader, i, &model->cameras.emplace_back())) return reader.error();
  }
  return reader.end("camera");
}

Result<void> parse_colmap_images_bin(std::string_view bytes, const std::string& file, ColmapModel* model) {
  RecordReader reader(bytes, file);
  uint64_t count = 0;
  if (!reader.read_count(&count, kImageBytes, "number of images")) return reader.error();
  model->images.reserve(count);
  for (uint64_t i = 1; i <= count; ++i) {
    if (!read_image_record(reader, i, &model->images.emplace_back(), model)) return reader.error();
  }
  return reader.end("image");
}

Result<void> parse_colmap_points_bin(std::string_view bytes, const std::string& file, ColmapModel* model) {
  RecordReader reader(bytes, file);
  uint64_t count = 0;
  if (!reader.read_count(&count, kPointBytes, "number of points")) return reader.error();
  model->points.reserve(count);
  for (uint64_t i = 1; i <= count; ++i) {
    if (!read_point(reader, i, &model->points.emplace_back(), model)) return reader.error();
  }
  return reader.end("point");
}

std::string format_colmap_cameras_bin(const ColmapModel& model) {
  std::string bytes;
  append_little_endian<uint64_t>(bytes, model.cameras.size());
  for (const ColmapCamera& camera : model.cameras) {
    append_little_endian(bytes, camera.id);
    append_little_endian(bytes, camera.model);
    append_little_endian(bytes, camera.width);
    append_little_endian(bytes, camera.height);
    for (const double parameter : camera.parameters) append_little_endian(bytes, parameter);
  }
  return bytes;
}

void append_colmap_image_bin(const ColmapImage& image, std::span<const ColmapKeypoint> keypoints,
                             std::string* bytes) {
  append_little_endian(*bytes, image.id);
  for (const double q : image.rotation) append_little_endian(*bytes, q);
  for (const double t : image.translation) append_little_endian(*bytes, t);
  append_little_endian(*bytes, image.camera_id);
  *bytes += image.name;
  *bytes += '\0';
  append_little_endian<uint64_t>(*bytes, keypoints.size());
  for (const ColmapKeypoint& keypoint : keypoints) {
    append_little_endian(*bytes, keypoint.x);
    append_little_endian(*bytes, keypoint.y);
    append_little_endian(*bytes, keypoint.point_id);
  }
}

std::string format_colmap_images_bin(const ColmapModel& model) {
  const std::span keypoints(model.keypoints);
  std::string bytes;
  append_little_endian<uint64_t>(bytes, model.images.size());
  for (const ColmapImage& image : model.images) {
    append_colmap_image_bin(
        image, keypoints.subspan(image.first_keypoint, image.last_keypoint - image.first_keypoint), &bytes);
  }
  return bytes;
}

void append_colmap_point_bin(const ColmapPoint& point, std::span<const ColmapTrackElement> elements,
                             std::string* bytes) {
  append_little_endian(*bytes, point.id);
  for (const double x : point.position) append_little_endian(*bytes, x);
  for (const uint8_t channel : point.rgb) append_little_endian(*bytes, channel);
  append_little_endian(*bytes, point.error);
  append_little_endian<uint64_t>(*bytes, elements.size());
  for (const ColmapTrackElement& element : elements) {
    append_little_endian(*bytes, element.image_id);
    append_little_endian(*bytes, element.keypoint);
  }
}

std::string format_colmap_points_bin(const ColmapModel& model) {
  const std::span elements(model.elements);
  std::string bytes;
  append_little_endian<uint64_t>(bytes, model.points.size());
  for (const ColmapPoint& point : model.points) {
    append_colmap_point_bin(
        point, elements.subspan(point.first_element, point.last_element - point.first_element), &bytes);
  }
  return bytes;
}

}  // namespace raysfm
