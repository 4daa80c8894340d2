#include "raysfm/io/colmap_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <system_error>
#include <vector>

#include "raysfm/io/atomic_file.h"
#include "raysfm/io/little_endian.h"

namespace raysfm {
namespace {

constexpr double kPixelOrigin = 0.5;  // COLMAP: the corner of the top-left pixel is (0, 0)

// Identifiers of COLMAP's camera models.
constexpr int32_t kPinhole = 1;
constexpr int32_t kOpenCv = 4;
constexpr int32_t kFullOpenCv = 6;

struct ColmapCamera {
  int32_t model = 0;
  std::vector<double> parameters;
};

template <typename Model>
std::vector<double> parameters_of(const Model& model) {
  const auto p = model.parameters();
  return {p.begin(), p.end()};
}

ColmapCamera to_colmap(const Pinhole& model) {
  return {kPinhole, parameters_of(model)};
}

ColmapCamera to_colmap(const Radtan& model) {
  ColmapCamera camera{kOpenCv, parameters_of(model)};
  camera.parameters.resize(8);
  if (model.k3 != 0) {
    camera.model = kFullOpenCv;
    camera.parameters.insert(camera.parameters.end(), {model.k3, 0, 0, 0});
  }
  return camera;
}

ColmapCamera to_colmap(const Rational& model) {
  return {kFullOpenCv, parameters_of(model)};
}

// One camera at one key frame.
struct ColmapImage {
  int keyframe = 0;
  int camera = 0;
  Rigid3 cam_from_world;
  std::vector<int> observations;  // indices into Reconstruction::observations, of points of this segment
};

struct TrackElement {
  uint32_t image_id = 0;
  uint32_t index = 0;  // among the image's points
};

struct ColmapPoint {
  std::vector<TrackElement> track;
  double error_sum = 0;  // pixels
  int errors = 0;
};

// The segment with most key frames; the first of equals.
int main_segment(const Reconstruction& reconstruction) {
  std::vector<int> keyframes(std::max<size_t>(1, reconstruction.segments.size()), 0);
  for (const KeyFrame& keyframe : reconstruction.keyframes) {
    const int segment = reconstruction.frames[keyframe.frame].segment;
    if (segment >= 0) ++keyframes[segment];
  }
  return static_cast<int>(std::max_element(keyframes.begin(), keyframes.end()) - keyframes.begin());
}

// Images in the order of their identifiers, which count from 1.
std::vector<ColmapImage> collect_images(const Reconstruction& reconstruction, int segment) {
  std::vector<ColmapImage> images;
  const int cameras = static_cast<int>(reconstruction.rig.cameras.size());
  for (int k = 0; k < static_cast<int>(reconstruction.keyframes.size()); ++k) {
    const KeyFrame& keyframe = reconstruction.keyframes[k];
    const PosedFrame& frame = reconstruction.frames[keyframe.frame];
    if (frame.segment != segment || !frame.world_from_rig) continue;
    const size_t first = images.size();
    for (int c = 0; c < cameras; ++c) {
      const Rigid3& rig_from_cam = reconstruction.rig.cameras[c].rig_from_cam;
      images.push_back({k, c, (*frame.world_from_rig * rig_from_cam).inverse(), {}});
    }
    for (int i = keyframe.first_observation; i < keyframe.last_observation; ++i) {
      const Observation& observation = reconstruction.observations[i];
      if (reconstruction.points[observation.point].segment != segment) continue;
      images[first + observation.camera].observations.push_back(i);
    }
  }
  return images;
}

std::vector<ColmapPoint> collect_tracks(const Reconstruction& reconstruction,
                                        const std::vector<ColmapImage>& images) {
  std::vector<ColmapPoint> points(reconstruction.points.size());
  for (size_t i = 0; i < images.size(); ++i) {
    const ColmapImage& image = images[i];
    const Camera& camera = reconstruction.rig.cameras[image.camera];
    for (size_t j = 0; j < image.observations.size(); ++j) {
      const Observation& observation = reconstruction.observations[image.observations[j]];
      ColmapPoint& point = points[observation.point];
      point.track.push_back({static_cast<uint32_t>(i + 1), static_cast<uint32_t>(j)});
      Eigen::Vector2d pixel;
      if (!camera.project(image.cam_from_world * reconstruction.points[observation.point].position, &pixel)) {
        continue;
      }
      point.error_sum += (pixel - observation.pixel).norm();
      ++point.errors;
    }
  }
  return points;
}

std::string cameras_bin(const Rig& rig) {
  std::string bytes;
  append_little_endian<uint64_t>(bytes, rig.cameras.size());
  for (size_t c = 0; c < rig.cameras.size(); ++c) {
    ColmapCamera camera =
        std::visit([](const auto& model) { return to_colmap(model); }, rig.cameras[c].model);
    camera.parameters[2] += kPixelOrigin;  // cx
    camera.parameters[3] += kPixelOrigin;  // cy
    append_little_endian<uint32_t>(bytes, static_cast<uint32_t>(c + 1));
    append_little_endian<int32_t>(bytes, camera.model);
    append_little_endian<uint64_t>(bytes, rig.cameras[c].width);
    append_little_endian<uint64_t>(bytes, rig.cameras[c].height);
    for (const double parameter : camera.parameters) append_little_endian(bytes, parameter);
  }
  return bytes;
}

std::string image_name(const Reconstruction& reconstruction, const ColmapImage& image) {
  const std::string& name = reconstruction.frames[reconstruction.keyframes[image.keyframe].frame].image_name;
  const std::vector<Camera>& cameras = reconstruction.rig.cameras;
  return cameras.size() == 1 ? name : cameras[image.camera].name + "/" + name;
}

std::string images_bin(const Reconstruction& reconstruction, const std::vector<ColmapImage>& images) {
  std::string bytes;
  append_little_endian<uint64_t>(bytes, images.size());
  for (size_t i = 0; i < images.size(); ++i) {
    const ColmapImage& image = images[i];
    const Eigen::Quaterniond& q = image.cam_from_world.rotation;
    const Eigen::Vector3d& t = image.cam_from_world.translation;
    append_little_endian<uint32_t>(bytes, static_cast<uint32_t>(i + 1));
    for (const double value : {q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z()})
      append_little_endian(bytes, value);
    append_little_endian<uint32_t>(bytes, image.camera + 1);
    bytes += image_name(reconstruction, image);
    bytes += '\0';
    append_little_endian<uint64_t>(bytes, image.observations.size());
    for (const int index : image.observations) {
      const Observation& observation = reconstruction.observations[index];
      append_little_endian<double>(bytes, observation.pixel.x() + kPixelOrigin);
      append_little_endian<double>(bytes, observation.pixel.y() + kPixelOrigin);
      append_little_endian<uint64_t>(bytes, observation.point + 1);
    }
  }
  return bytes;
}

std::string points_bin(const Reconstruction& reconstruction, const std::vector<ColmapPoint>& points) {
  std::string bytes;
  const auto seen =
      std::count_if(points.begin(), points.end(), [](const auto& p) { return !p.track.empty(); });
  append_little_endian<uint64_t>(bytes, seen);
  for (size_t i = 0; i < points.size(); ++i) {
    const ColmapPoint& point = points[i];
    if (point.track.empty()) continue;
    const MapPoint& map_point = reconstruction.points[i];
    append_little_endian<uint64_t>(bytes, i + 1);
    for (int k = 0; k < 3; ++k) append_little_endian<double>(bytes, map_point.position[k]);
    for (const uint8_t channel : map_point.rgb) append_little_endian(bytes, channel);
    append_little_endian<double>(bytes, point.errors > 0 ? point.error_sum / point.errors : -1.0);
    append_little_endian<uint64_t>(bytes, point.track.size());
    for (const TrackElement& element : point.track) {
      append_little_endian(bytes, element.image_id);
      append_little_endian(bytes, element.index);
    }
  }
  return bytes;
}

}  // namespace

Result<void> write_colmap_model(const Reconstruction& reconstruction, const std::filesystem::path& folder) {
  std::error_code failure;
  std::filesystem::create_directories(folder, failure);
  if (failure) {
    return bad_input(fmt::format("{}: folder cannot be created: {}", folder.string(), failure.message()));
  }
  const std::vector<ColmapImage> images = collect_images(reconstruction, main_segment(reconstruction));
  const std::vector<ColmapPoint> points = collect_tracks(reconstruction, images);
  if (auto written = write_file(folder / "cameras.bin", cameras_bin(reconstruction.rig)); !written)
    return written;
  if (auto written = write_file(folder / "images.bin", images_bin(reconstruction, images)); !written)
    return written;
  return write_file(folder / "points3D.bin", points_bin(reconstruction, points));
}

}  // namespace raysfm
