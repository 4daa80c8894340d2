#include <fmt/format.h>

#include <cmath>
#include <iterator>
#include <optional>
#include <variant>

#include "raysfm/camera_files/camera_convert.h"
#include "raysfm/exports/scene_formats.h"
#include "raysfm/files/atomic_file.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;

// Middle of the image; cameras of images of unknown size count from it.
Eigen::Vector2d middle(const Camera& camera) {
  if (camera.width <= 0 || camera.height <= 0) return Eigen::Vector2d::Zero();
  return {(camera.width - 1) / 2.0, (camera.height - 1) / 2.0};
}

// f, k1 and k2.
std::optional<Radtan> as_bundler(const Camera& camera) {
  constexpr double kPixel = 1e-6;
  for (const CameraModel& model : equivalent_models(camera.model)) {
    const auto* m = std::get_if<Radtan>(&model);
    if (!m || m->p1 != 0 || m->p2 != 0 || m->k3 != 0 || std::abs(m->fx - m->fy) > kPixel) continue;
    if ((Eigen::Vector2d(m->cx, m->cy) - middle(camera)).cwiseAbs().maxCoeff() <= kPixel) return *m;
  }
  return std::nullopt;
}

// What the format counts y and z against.
Eigen::Vector3d turned(const Eigen::Vector3d& x) {
  return {x.x(), -x.y(), -x.z()};
}

struct Sighting {
  int image, key;
  Eigen::Vector2d pixel;
};

}  // namespace

Result<void> bundler_holds(const Camera& camera) {
  if (as_bundler(camera)) return {};
  return bad_input(
      "cameras with one focal length, the principal point in the middle of the image and no distortion but "
      "k1 and k2 "
      "are held");
}

Result<void> write_bundler(const ExportScene& scene, const fs::path& folder) {
  std::vector<std::vector<Sighting>> sightings(scene.points.size());
  std::string text = "# Bundle file v0.3\n", names;
  auto out = std::back_inserter(text);
  fmt::format_to(out, "{} {}\n", scene.images.size(), scene.points.size());
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const ExportImage& image = scene.images[i];
    if (image.name.find_first_of("\r\n") != std::string::npos) {
      return bad_input("the name of an image has a line end, which list.txt cannot hold");
    }
    names += image.name + "\n";
    const Camera& camera = scene.cameras[image.camera];
    const Radtan lens = *as_bundler(camera);
    const Rigid3 cam_from_world = image.world_from_cam.inverse();
    fmt::format_to(out, "{} {} {}\n", lens.fx, lens.k1, lens.k2);
    const Eigen::Matrix3d rotation = cam_from_world.rotation.toRotationMatrix();
    for (int r = 0; r < 3; ++r) {
      const double sign = r == 0 ? 1 : -1;
      fmt::format_to(out, "{} {} {}\n", sign * rotation(r, 0), sign * rotation(r, 1), sign * rotation(r, 2));
    }
    const Eigen::Vector3d t = turned(cam_from_world.translation);
    fmt::format_to(out, "{} {} {}\n", t.x(), t.y(), t.z());
    for (size_t k = 0; k < image.keypoints.size(); ++k) {
      const Eigen::Vector2d pixel = image.keypoints[k].pixel - middle(camera);
      sightings[image.keypoints[k].point].push_back(
          {static_cast<int>(i), static_cast<int>(k), {pixel.x(), -pixel.y()}});
    }
  }
  for (size_t p = 0; p < scene.points.size(); ++p) {
    const auto& [position, rgb, segment] = scene.points[p];
    fmt::format_to(out, "{} {} {}\n{} {} {}\n{}", position.x(), position.y(), position.z(), rgb[0], rgb[1],
                   rgb[2], sightings[p].size());
    for (const Sighting& s : sightings[p]) {
      fmt::format_to(out, " {} {} {} {}", s.image, s.key, s.pixel.x(), s.pixel.y());
    }
    text += "\n";
  }
  if (auto written = write_file(folder / "list.txt", names); !written) return written;
  return write_file(folder / "bundle.out", text);
}

}  // namespace raysfm
