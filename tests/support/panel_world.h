#pragma once

#include <array>
#include <limits>
#include <memory>
#include <optional>
#include <vector>

#include "raysfm/views/view.h"
#include "support/texture.h"

namespace raysfm::testing_support {

// Three textured walls at different distances in front of the origin (x right, y down, z forward, metres),
// with the exact point that every pixel sees: truth from a few lines of algebra.
class PanelWorld {
 public:
  explicit PanelWorld(uint64_t seed) {
    const auto along = [](double yaw) { return Eigen::Vector3d(std::cos(yaw), 0, -std::sin(yaw)); };
    add({0, 0, 7}, along(0.1), 9, 6, seed);
    add({-1.5, 0.1, 4.2}, along(-0.3), 0.75, 0.9, seed + 1);
    add({1.1, -0.2, 3.4}, along(0.25), 0.6, 0.7, seed + 2);
  }

  // Where a ray meets the world first.
  std::optional<Eigen::Vector3d> hit(const Ray& ray) const {
    const std::optional<Seen> seen = look(ray);
    if (!seen) return std::nullopt;
    return ray.origin + seen->distance * ray.direction;
  }

  double grey(const Ray& ray) const {
    const std::optional<Seen> seen = look(ray);
    return seen ? seen->panel->texture(kPixelsPerMetre * seen->place) : 0.0;
  }

 private:
  static constexpr double kPixelsPerMetre = 60;  // of the textures
  static constexpr double kShortest = 8;         // pixels of the textures

  struct Panel {
    Eigen::Vector3d center, right;
    double half_width, half_height;  // metres
    Texture texture;
  };
  struct Seen {
    double distance;
    Eigen::Vector2d place;
    const Panel* panel;
  };

  void add(const Eigen::Vector3d& center, const Eigen::Vector3d& right, double half_width, double half_height,
           uint64_t seed) {
    const double shortest = kShortest * center.z() / 3.4;  // about equally fine in the image
    panels_.push_back({center, right, half_width, half_height, Texture(seed, shortest, 6 * shortest, 45)});
  }

  std::optional<Seen> look(const Ray& ray) const {
    std::optional<Seen> nearest;
    for (const Panel& panel : panels_) {
      const Eigen::Vector3d down = Eigen::Vector3d::UnitY(), normal = panel.right.cross(down);
      const double distance = normal.dot(panel.center - ray.origin) / normal.dot(ray.direction);
      if (!(distance > 0) || (nearest && nearest->distance < distance)) continue;
      const Eigen::Vector3d offset = ray.origin + distance * ray.direction - panel.center;
      const Eigen::Vector2d place(panel.right.dot(offset), down.dot(offset));
      if (std::abs(place.x()) > panel.half_width || std::abs(place.y()) > panel.half_height) continue;
      nearest = Seen{distance, place, &panel};
    }
    return nearest;
  }

  std::vector<Panel> panels_;
};

// 320 x 240 pixels, 65 degrees wide; or that of its pictures enlarged k times.
inline Camera small_camera(int k = 1) {
  const auto center = [&](double c) { return (c + 0.5) * k - 0.5; };
  Camera camera;
  camera.name = "camera";
  camera.model = Radtan::from_parameters(
      {250.0 * k, 252.0 * k, center(160), center(119), -0.12, 0.03, 0.0005, -0.0008, 0});
  camera.width = 320 * k;
  camera.height = 240 * k;
  return camera;
}

// Bilinearly, as a program that enlarges videos does.
inline GrayImage enlarged(const GrayImage& image, int k) {
  GrayImage out(image.width() * k, image.height() * k);
  for (int y = 0; y < out.height(); ++y) {
    for (int x = 0; x < out.width(); ++x) {
      const double u = std::clamp((x + 0.5) / k - 0.5, 0.0, image.width() - 1.0);
      const double v = std::clamp((y + 0.5) / k - 0.5, 0.0, image.height() - 1.0);
      const int left = std::min(int(u), image.width() - 2), above = std::min(int(v), image.height() - 2);
      const uint8_t *top = image.row(above) + left, *bottom = image.row(above + 1) + left;
      const double wu = u - left, wv = v - above;
      out.row(y)[x] = to_grey((1 - wv) * ((1 - wu) * top[0] + wu * top[1]) +
                              wv * ((1 - wu) * bottom[0] + wu * bottom[1]));
    }
  }
  return out;
}

// The ray of a pixel of a rig's first camera in the world frame; the pixel must have one.
inline Ray world_ray(const Camera& camera, const Rigid3& rig_from_world, const Eigen::Vector2d& pixel) {
  Ray ray;
  camera.ray(pixel, &ray);
  const Rigid3 world_from_cam = rig_from_world.inverse() * camera.rig_from_cam;
  return {world_from_cam * ray.origin, world_from_cam.rotation * ray.direction};
}

inline ViewPtr as_view(GrayImage image, int frame, int features = 600, double seconds_per_frame = 0.1) {
  auto view = std::make_shared<View>();
  view->frame = frame;
  view->timestamp = seconds_per_frame * frame;
  view->cameras.resize(1);
  view->cameras[0].image = std::move(image);
  HarrisDetector detector;
  detect(detector, HarrisOptions{.max_features = features, .mask = {}}, &view->cameras[0]);
  return view;
}

// A view as it was before its corners were detected.
inline ViewPtr without_corners(const View& view) {
  auto out = std::make_shared<View>();
  out->frame = view.frame;
  out->timestamp = view.timestamp;
  for (const CameraView& camera : view.cameras) {
    CameraView& image = out->cameras.emplace_back();
    image.width = camera.width;
    image.height = camera.height;
    image.octaves = camera.octaves;
    image.thumbnail = camera.thumbnail;
    image.thumbnail_scale = camera.thumbnail_scale;
  }
  return out;
}

// What the camera sees, with normal noise of two grey levels.
inline GrayImage picture(const PanelWorld& world, const Camera& camera, const Rigid3& rig_from_world,
                         Rng& rng) {
  GrayImage image(camera.width, camera.height);
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      const double light = world.grey(world_ray(camera, rig_from_world, {x, y}));
      image.row(y)[x] = to_grey(light + 2.0 * rng.normal());
    }
  }
  return image;
}

// The picture of a frame; `seed` is of the noise.
inline ViewPtr film(const PanelWorld& world, const Camera& camera, const Rigid3& rig_from_world, int frame,
                    uint64_t seed = 0) {
  Rng rng(seed, static_cast<uint64_t>(frame));
  return as_view(picture(world, camera, rig_from_world, rng), frame);
}

// One grey level everywhere.
inline GrayImage flat_image(int width, int height, uint8_t grey) {
  GrayImage image(width, height);
  for (int y = 0; y < height; ++y) std::fill_n(image.row(y), width, grey);
  return image;
}

// The same with small_camera(k) at the place of a camera of the rig.
inline ViewPtr film_enlarged(const PanelWorld& world, const Rigid3& rig_from_cam,
                             const Rigid3& rig_from_world, int frame, int k) {
  Camera camera = small_camera();
  camera.rig_from_cam = rig_from_cam;
  Rng rng(0, static_cast<uint64_t>(frame));
  return as_view(enlarged(picture(world, camera, rig_from_world, rng), k), frame);
}

inline ViewPtr black_view(int width, int height, int frame) {
  return as_view(flat_image(width, height, 0), frame);
}

// Degrees between two orientations.
inline double degrees_between(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b) {
  return a.angularDistance(b) * 180 / std::numbers::pi;
}

inline double degrees_between(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b)) * 180 / std::numbers::pi;
}

}  // namespace raysfm::testing_support
