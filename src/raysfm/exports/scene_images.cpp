#include "raysfm/exports/scene_images.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <memory>

#include "raysfm/frames/frame_set.h"
#include "raysfm/frames/image_file.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;

// The part of an image that is the camera's.
Image<uint8_t> bgr_of(const GrayImage& gray, const ColorPlanes& colors, const Camera& camera) {
  Image<uint8_t> bgr(3 * camera.width, camera.height);
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      const int u = x + camera.roi.x, v = y + camera.roi.y;
      const uint8_t grey = gray.row(v)[u];
      const std::array<uint8_t, 3> rgb =
          colors.empty() ? std::array<uint8_t, 3>{grey, grey, grey} : colors.at(u, v, grey);
      for (int c = 0; c < 3; ++c) bgr.row(y)[3 * x + c] = rgb[2 - c];
    }
  }
  return bgr;
}

Result<void> hand_over(const ExportScene& scene, size_t i, const GrayImage& gray, const ColorPlanes& colors,
                       const SceneImageVisitor& visit) {
  const ExportImage& image = scene.images[i];
  const Camera& camera = scene.cameras[image.camera];
  const Roi& roi = camera.roi;
  const bool whole = roi.w == 0;
  const int width = whole ? camera.width : std::max(gray.width(), roi.x + roi.w);
  const int height = whole ? camera.height : std::max(gray.height(), roi.y + roi.h);
  if (gray.width() != width || gray.height() != height) {
    return bad_input(fmt::format("--images: image '{}' of {} x {} pixels is not allowed, {} x {} are",
                                 image.name, gray.width(), gray.height(), width, height));
  }
  return visit(i, bgr_of(gray, colors, camera));
}

const Camera* camera_named(const Rig& rig, const std::string& name) {
  const auto found = std::ranges::find(rig.cameras, name, &Camera::name);
  return found == rig.cameras.end() ? nullptr : &*found;
}

// Results do not tell which stream, or which part of one, a camera of a rig sees.
Result<void> find_streams(const ImageInput& input, const Input& opened, ExportScene* scene) {
  if (!scene->rig) return {};
  for (size_t c = 0; c < scene->cameras.size(); ++c) {
    Camera& camera = scene->cameras[c];
    const Camera* known = camera_named(input.cameras, camera.name);
    if (!known && opened.calibration) known = camera_named(*opened.calibration, camera.name);
    if (!known && scene->cameras.size() != opened.streams.size()) {
      return bad_input(
          fmt::format("--images: nothing tells which of {} streams camera '{}' sees; --camera does",
                      opened.streams.size(), camera.name));
    }
    camera.stream = known ? known->stream : static_cast<int>(c);
    camera.roi = known ? known->roi : Roi{};
  }
  return {};
}

// The images of a model of another tool are files of a folder, in any order.
Result<void> visit_files(const ImageInput& input, const Reconstruction& world, const ExportScene& scene,
                         const SceneImageVisitor& visit) {
  if (input.paths.size() != 1 || !fs::is_directory(input.paths[0])) {
    return bad_input(
        fmt::format("--images: {} is not allowed, the folder of the model's images is", input.paths[0]));
  }
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const fs::path path = fs::path(input.paths[0]) / world.frames[scene.images[i].frame].image_name;
    const Result<DecodedImage> decoded = read_image(path);
    if (!decoded) return decoded.error();
    if (auto visited = hand_over(scene, i, decoded->gray, decoded->colors, visit); !visited) return visited;
  }
  return {};
}

// The frames of `streams` that the scene has, counted as `track` and `solve` do.
Result<void> visit_streams(const std::vector<std::unique_ptr<FrameSource>>& streams,
                           const Reconstruction& world, const ExportScene& scene,
                           const SceneImageVisitor& visit) {
  FrameSetReader reader(streams);
  size_t next = 0;
  for (int number = 0; next < scene.images.size(); ++number) {
    const Result<std::vector<InputFrame>> set = reader.next();
    if (!set) return set.error();
    if (set->empty()) {
      return bad_input(
          fmt::format("--images: {} frames are not enough, the result has {}", number, world.frames.size()));
    }
    for (; next < scene.images.size() && scene.images[next].frame == number; ++next) {
      const auto stream = static_cast<size_t>(scene.cameras[scene.images[next].camera].stream);
      if (stream >= set->size()) {
        return bad_input(fmt::format("--images: {} streams are not enough, camera '{}' has number {}",
                                     set->size(), scene.cameras[scene.images[next].camera].name, stream));
      }
      const InputFrame& frame = (*set)[stream];
      if (!frame.defect.empty()) return bad_input(frame.defect);
      const std::string& expected = world.frames[number].image_name;
      if (!expected.empty() && expected != set->front().name) {
        return bad_input(fmt::format("--images: frame {} is '{}' there, and '{}' in the result", number,
                                     set->front().name, expected));
      }
      if (auto visited = hand_over(scene, next, frame.gray, frame.colors, visit); !visited) return visited;
    }
  }
  return {};
}

}  // namespace

Result<void> visit_images(const ImageInput& input, const Reconstruction& world, const ExportScene& scene,
                          const SceneImageVisitor& visit) {
  if (world.origin == Origin::kAdjust) return visit_files(input, world, scene, visit);
  ExportScene placed = scene;
  Result<Input> opened = open_input(input.paths, {.threads = input.threads, .range = world.range});
  if (!opened) return opened.error();
  for (const auto& stream : opened->streams) stream->allow_any_size();
  if (auto found = find_streams(input, *opened, &placed); !found) return found;
  return visit_streams(opened->streams, world, placed, visit);
}

}  // namespace raysfm
