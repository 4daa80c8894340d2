#include "raysfm/colmap_bal/colmap_model.h"

#include <fmt/format.h>

#include <cmath>
#include <system_error>
#include <unordered_map>

#include "raysfm/colmap_bal/colmap_format.h"
#include "raysfm/files/atomic_file.h"
#include "raysfm/files/text_file.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;

constexpr uintmax_t kMaxModelBytes = uintmax_t{16} << 30;

// Names of the three files, for opening and for messages.
struct FileNames {
  std::string cameras, images, points;
  FileNames(const std::string& folder, bool binary) {
    const char* ending = binary ? ".bin" : ".txt";
    cameras = (fs::path(folder) / (std::string("cameras") + ending)).string();
    images = (fs::path(folder) / (std::string("images") + ending)).string();
    points = (fs::path(folder) / (std::string("points3D") + ending)).string();
  }
};

// Index of each record by its identifier; an error where two share one.
template <typename Id, typename Record>
Result<void> index_records(const std::vector<Record>& records, const std::string& file, const char* kind,
                           std::unordered_map<Id, int>* index) {
  index->reserve(records.size());
  for (size_t i = 0; i < records.size(); ++i) {
    if (index->emplace(records[i].id, static_cast<int>(i)).second) continue;
    return bad_input(fmt::format("{}: {} {}: a second time is not allowed, each identifier once is", file,
                                 kind, records[i].id));
  }
  return {};
}

Result<void> link_images(const FileNames& names, ColmapModel* model) {
  std::unordered_map<uint32_t, int> cameras;
  if (auto r = index_records(model->cameras, names.cameras, "camera", &cameras); !r) return r;
  for (ColmapImage& image : model->images) {
    const auto camera = cameras.find(image.camera_id);
    if (camera == cameras.end()) {
      return bad_input(fmt::format("{}: image {}: camera {} is not allowed, those of {} are", names.images,
                                   image.id, image.camera_id, names.cameras));
    }
    image.camera = camera->second;
    const auto& [w, x, y, z] = image.rotation;
    const double length = Eigen::Vector4d(w, x, y, z).norm();
    if (!(length > 0) || !std::isfinite(length)) {
      return bad_input(fmt::format("{}: image {}: a quaternion of length {} is not allowed, one above 0 is",
                                   names.images, image.id, length));
    }
  }
  return {};
}

Result<void> wrong_element(const FileNames& names, const ColmapPoint& point,
                           const ColmapTrackElement& element, const std::string& why) {
  return bad_input(fmt::format("{}: point {}: image {} keypoint {} is not allowed in its track, {}",
                               names.points, point.id, element.image_id, element.keypoint, why));
}

// Every element of a track leads to a keypoint of that point, and every such keypoint is in the track.
Result<void> link_tracks(const FileNames& names, ColmapModel* model) {
  std::unordered_map<uint32_t, int> images;
  if (auto r = index_records(model->images, names.images, "image", &images); !r) return r;
  std::vector<bool> in_track(model->keypoints.size(), false);
  for (const ColmapPoint& point : model->points) {
    for (size_t e = point.first_element; e < point.last_element; ++e) {
      ColmapTrackElement& element = model->elements[e];
      const auto found = images.find(element.image_id);
      if (found == images.end()) {
        return wrong_element(names, point, element, fmt::format("only images of {} are", names.images));
      }
      element.image = found->second;
      const ColmapImage& image = model->images[found->second];
      const size_t keypoints = image.last_keypoint - image.first_keypoint;
      if (element.keypoint >= keypoints) {
        return wrong_element(names, point, element, fmt::format("the image has {} keypoints", keypoints));
      }
      const size_t keypoint = image.first_keypoint + element.keypoint;
      if (model->keypoints[keypoint].point_id != point.id || in_track[keypoint]) {
        return wrong_element(names, point, element,
                             in_track[keypoint] ? "it is there already" : "the keypoint belongs to another");
      }
      in_track[keypoint] = true;
    }
  }
  for (const ColmapImage& image : model->images) {
    for (size_t k = image.first_keypoint; k < image.last_keypoint; ++k) {
      if (in_track[k] || model->keypoints[k].point_id == kNoColmapPoint) continue;
      return bad_input(fmt::format(
          "{}: image {} keypoint {}: point {} is not allowed, a point of {} with this "
          "keypoint in its track is",
          names.images, image.id, k - image.first_keypoint, model->keypoints[k].point_id, names.points));
    }
  }
  return {};
}

}  // namespace

Result<ColmapModel> parse_colmap(const ColmapFiles& files, const std::string& folder) {
  const FileNames names(folder, files.binary);
  ColmapModel model;
  model.binary = files.binary;
  Result<void> read = files.binary ? parse_colmap_cameras_bin(files.cameras, names.cameras, &model)
                                   : parse_colmap_cameras_txt(files.cameras, names.cameras, &model);
  if (read) {
    read = files.binary ? parse_colmap_images_bin(files.images, names.images, &model)
                        : parse_colmap_images_txt(files.images, names.images, &model);
  }
  if (read) {
    read = files.binary ? parse_colmap_points_bin(files.points, names.points, &model)
                        : parse_colmap_points_txt(files.points, names.points, &model);
  }
  if (read) read = link_images(names, &model);
  if (read) read = link_tracks(names, &model);
  std::unordered_map<uint64_t, int> points;
  if (read) read = index_records(model.points, names.points, "point", &points);
  if (!read) return read.error();
  return model;
}

ColmapFiles format_colmap(const ColmapModel& model) {
  if (model.binary) {
    return {true, format_colmap_cameras_bin(model), format_colmap_images_bin(model),
            format_colmap_points_bin(model)};
  }
  return {false, format_colmap_cameras_txt(model), format_colmap_images_txt(model),
          format_colmap_points_txt(model)};
}

bool is_colmap_model(const fs::path& folder) {
  for (const bool binary : {true, false}) {
    const FileNames names(folder.string(), binary);
    std::error_code ignored;
    if (fs::exists(names.cameras, ignored) || fs::exists(names.images, ignored) ||
        fs::exists(names.points, ignored)) {
      return true;
    }
  }
  return false;
}

Result<ColmapModel> read_colmap_model(const fs::path& folder) {
  std::error_code ignored;
  const auto has = [&](const char* file) { return fs::exists(folder / file, ignored); };
  // What is missing is reported of the kind of which there is something.
  const bool complete = has("cameras.bin") && has("images.bin") && has("points3D.bin");
  const bool some_text = has("cameras.txt") || has("images.txt") || has("points3D.txt");
  ColmapFiles files{.binary = complete || !some_text, .cameras = {}, .images = {}, .points = {}};
  const FileNames names(folder.string(), files.binary);
  const std::pair<const std::string*, std::string*> contents[] = {
      {&names.cameras, &files.cameras}, {&names.images, &files.images}, {&names.points, &files.points}};
  for (const auto& [path, content] : contents) {
    Result<std::string> text = read_text_file(*path, kMaxModelBytes);
    if (!text) return text.error();
    *content = *std::move(text);
  }
  return parse_colmap(files, folder.string());
}

Result<void> write_colmap_model(const ColmapModel& model, const fs::path& folder) {
  if (auto created = create_folder(folder); !created) return created;
  const FileNames names(folder.string(), model.binary);
  const ColmapFiles files = format_colmap(model);
  Result<void> written = write_file(names.cameras, files.cameras);
  if (written) written = write_file(names.images, files.images);
  if (written) written = write_file(names.points, files.points);
  return written;
}

}  // namespace raysfm
