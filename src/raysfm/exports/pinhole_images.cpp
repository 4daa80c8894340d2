#include "raysfm/exports/pinhole_images.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "raysfm/files/atomic_file.h"
#include "raysfm/frames/frame_set.h"
#include "raysfm/frames/image_file.h"
#include "raysfm/frames/image_writer.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;

using Bgr = Image<uint8_t>;  // blue, green and red of a pixel side by side

// The part of an image that is the camera's.
Bgr bgr_of(const GrayImage& gray, const ColorPlanes& colors, const Camera& camera) {
  Bgr bgr(3 * camera.width, camera.height);
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

// Pixel of the source for each pixel of a pinhole; x is negative where there is none.
class PixelMap {
 public:
  PixelMap(const Camera& pinhole, const PinholeSource& source, const Eigen::Matrix3d& source_from_pinhole)
      : pixels_(static_cast<size_t>(pinhole.width) * pinhole.height, {-1, -1}), width_(pinhole.width) {
    for (size_t i = 0; i < pixels_.size(); ++i) {
      Ray ray;
      Eigen::Vector2d pixel;
      if (!pinhole.ray({static_cast<double>(i % width_), static_cast<double>(i / width_)}, &ray)) continue;
      if (!source.pixel(source_from_pinhole * ray.direction, &pixel)) continue;
      const Camera& camera = source.camera();
      pixels_[i] = {static_cast<float>(std::clamp(pixel.x(), 0.0, camera.width - 1.0)),
                    static_cast<float>(std::clamp(pixel.y(), 0.0, camera.height - 1.0))};
    }
  }

  Bgr resample(const Bgr& from) const {
    const int height = static_cast<int>(pixels_.size()) / width_, last_x = from.width() / 3 - 1;
    Bgr to(3 * width_, height);
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width_; ++x) {
        const Eigen::Vector2f& at = pixels_[static_cast<size_t>(y) * width_ + x];
        uint8_t* bgr = to.row(y) + 3 * x;
        if (at.x() < 0) {
          std::fill_n(bgr, 3, 0);
          continue;
        }
        const int left = static_cast<int>(at.x()), top = static_cast<int>(at.y());
        const int right = std::min(left + 1, last_x), bottom = std::min(top + 1, from.height() - 1);
        const float a = at.x() - static_cast<float>(left), b = at.y() - static_cast<float>(top);
        const uint8_t *upper = from.row(top), *lower = from.row(bottom);
        for (int c = 0; c < 3; ++c) {
          const float above = (1 - a) * upper[3 * left + c] + a * upper[3 * right + c];
          const float below = (1 - a) * lower[3 * left + c] + a * lower[3 * right + c];
          bgr[c] = static_cast<uint8_t>(std::lround((1 - b) * above + b * below));
        }
      }
    }
    return to;
  }

 private:
  std::vector<Eigen::Vector2f> pixels_;
  int width_;
};

// Writes the images of one frame after the other.
class ImageWriter {
 public:
  ImageWriter(const ExportScene& scene, const UndistortedScene* pinholes, fs::path folder)
      : scene_(scene), pinholes_(pinholes), folder_(std::move(folder)) {
    if (pinholes) maps_.resize(pinholes->scene.cameras.size());
  }

  // Image `i` of the scene.
  Result<void> write(size_t i, const GrayImage& gray, const ColorPlanes& colors) {
    const ExportImage& image = scene_.images[i];
    const Camera& camera = scene_.cameras[image.camera];
    const Roi& roi = camera.roi;
    const bool whole = roi.w == 0;
    const int width = whole ? camera.width : std::max(gray.width(), roi.x + roi.w);
    const int height = whole ? camera.height : std::max(gray.height(), roi.y + roi.h);
    if (gray.width() != width || gray.height() != height) {
      return bad_input(fmt::format("--images: image '{}' of {} x {} pixels is not allowed, {} x {} are",
                                   image.name, gray.width(), gray.height(), width, height));
    }
    const Bgr bgr = bgr_of(gray, colors, camera);
    return pinholes_ ? write_pinholes(image, bgr) : write_one(image.name, bgr);
  }

 private:
  Result<void> write_one(const std::string& name, const Bgr& bgr) {
    const fs::path path = folder_ / name;
    if (auto created = create_folder(path.parent_path()); !created) return created;
    return write_color_png(path, bgr);
  }

  // They stand in the order of the images that they are made of.
  Result<void> write_pinholes(const ExportImage& image, const Bgr& bgr) {
    const std::vector<ExportImage>& made = pinholes_->scene.images;
    for (; next_ < made.size(); ++next_) {
      const int camera = made[next_].camera;
      if (made[next_].frame != image.frame || pinholes_->source[camera] != image.camera) break;
      if (auto written = write_one(made[next_].name, map_of(camera).resample(bgr)); !written) return written;
    }
    return {};
  }

  // Of lenses that change from frame to frame only the last ones are kept.
  const PixelMap& map_of(int camera) {
    if (!maps_[camera]) {
      if (!pinholes_->scene.rig) std::ranges::fill(maps_, std::nullopt);
      maps_[camera].emplace(pinholes_->scene.cameras[camera], pinholes_->sources[pinholes_->source[camera]],
                            pinholes_->rotations[camera]);
    }
    return *maps_[camera];
  }

  const ExportScene& scene_;
  const UndistortedScene* pinholes_;
  fs::path folder_;
  std::vector<std::optional<PixelMap>> maps_;  // by camera of the pinholes
  size_t next_ = 0;                            // image of the pinholes
};

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
Result<void> write_files(const ImageInput& input, const Reconstruction& world, const ExportScene& scene,
                         ImageWriter* writer) {
  if (input.paths.size() != 1 || !fs::is_directory(input.paths[0])) {
    return bad_input(
        fmt::format("--images: {} is not allowed, the folder of the model's images is", input.paths[0]));
  }
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const fs::path path = fs::path(input.paths[0]) / world.frames[scene.images[i].frame].image_name;
    const Result<DecodedImage> decoded = read_image(path);
    if (!decoded) return decoded.error();
    if (auto written = writer->write(i, decoded->gray, decoded->colors); !written) return written;
  }
  return {};
}

// The frames of `streams` that the scene has, counted as `track` and `solve` do.
Result<void> write_streams(const std::vector<std::unique_ptr<FrameSource>>& streams,
                           const Reconstruction& world, const ExportScene& scene, ImageWriter* writer) {
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
      if (auto written = writer->write(next, frame.gray, frame.colors); !written) return written;
    }
  }
  return {};
}

}  // namespace

Result<void> write_images(const ImageInput& input, const Reconstruction& world, const ExportScene& scene,
                          const UndistortedScene* pinholes, const fs::path& folder) {
  ExportScene placed = scene;
  ImageWriter writer(placed, pinholes, folder);
  if (world.origin == Origin::kAdjust) return write_files(input, world, placed, &writer);
  Result<Input> opened = open_input(input.paths, {.threads = input.threads, .range = world.range});
  if (!opened) return opened.error();
  for (const auto& stream : opened->streams) stream->allow_any_size();
  if (auto found = find_streams(input, *opened, &placed); !found) return found;
  return write_streams(opened->streams, world, placed, &writer);
}

}  // namespace raysfm
