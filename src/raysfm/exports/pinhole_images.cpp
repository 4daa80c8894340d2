#include "raysfm/exports/pinhole_images.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "raysfm/files/atomic_file.h"
#include "raysfm/frames/image_writer.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;

using Bgr = Image<uint8_t>;  // blue, green and red of a pixel side by side

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
  Result<void> write(size_t i, const Bgr& bgr) {
    const ExportImage& image = scene_.images[i];
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

}  // namespace

Result<void> write_images(const ImageInput& input, const Reconstruction& world, const ExportScene& scene,
                          const UndistortedScene* pinholes, const fs::path& folder) {
  ImageWriter writer(scene, pinholes, folder);
  return visit_images(input, world, scene, [&](size_t i, const Bgr& bgr) { return writer.write(i, bgr); });
}

}  // namespace raysfm
