#include "raysfm/worlds/builder.h"

#include <cmath>

namespace raysfm::synth {

using Eigen::Vector2d;
using Eigen::Vector3d;

Builder::Builder(std::string name, uint64_t seed, ThreadPool& pool) : random_(seed, 1) {
  world_.name = std::move(name);
  world_.materials = std::make_shared<MaterialLibrary>(pool);
}

Finish Builder::finish(Pattern pattern, int variant, const Colour& tint, float variety) {
  Finish f;
  f.texture = world_.materials->find(pattern, variant);
  f.period = period_of(pattern);
  if (pattern == Pattern::kPlaster) f.stains = 0.2f;  // has its own
  const float light = static_cast<float>(random_.uniform(-variety, variety));
  const float hue = static_cast<float>(random_.uniform(-0.5 * variety, 0.5 * variety));
  f.tint = tint * (1.f + light) * Colour(1.f + hue, 1.f, 1.f - hue);
  f.shift_u = static_cast<float>(random_.uniform());
  f.shift_v = static_cast<float>(random_.uniform());
  return f;
}

void Builder::quad(const Vector3d& corner, const Vector3d& right, const Vector3d& down, double width,
                   double height, const Finish& finish) {
  if (width <= 0 || height <= 0) return;
  world_.quads.push_back({corner, right, down, width, height, finish});
}

void Builder::level(double x0, double x1, double z0, double z1, double y, const Finish& finish) {
  quad({x0, y, z1}, Vector3d::UnitX(), -Vector3d::UnitZ(), x1 - x0, z1 - z0, finish);
}

void Builder::wall(const Vector2d& a, const Vector2d& b, double low, double high, const Finish& finish) {
  const Vector2d along = (b - a).normalized();
  quad({a.x(), -high, a.y()}, {along.x(), 0, along.y()}, Vector3d::UnitY(), (b - a).norm(), high - low,
       finish);
}

void Builder::box(const Vector3d& foot, const Vector3d& size, double yaw, const Finish& sides,
                  const Finish& top) {
  const Vector3d x(std::cos(yaw), 0, -std::sin(yaw)), z(std::sin(yaw), 0, std::cos(yaw)),
      up = -Vector3d::UnitY();
  const Vector3d hx = 0.5 * size.x() * x, hz = 0.5 * size.z() * z, roof = foot + size.y() * up;
  quad(roof - hx - hz, x, -up, size.x(), size.y(), sides);
  quad(roof + hx - hz, z, -up, size.z(), size.y(), sides);
  quad(roof + hx + hz, -x, -up, size.x(), size.y(), sides);
  quad(roof - hx + hz, -z, -up, size.z(), size.y(), sides);
  quad(roof - hx + hz, x, -z, size.x(), size.z(), top);
}

void Builder::ellipsoid(const Vector3d& centre, const Vector3d& radii, const Finish& finish) {
  world_.ellipsoids.push_back({centre, Eigen::Matrix3d::Identity(), radii, finish});
}

void Builder::tree(const Vector3d& foot, double size) {
  const Finish bark = finish(Pattern::kPlanks, 7, {0.55f, 0.5f, 0.45f});
  box(foot, {0.05 * size, 0.5 * size, 0.05 * size}, random_.uniform(0, 1), bark, bark);
  const Vector3d crown = foot - Vector3d(0, 0.68 * size, 0);
  for (int i = 0; i < 7; ++i) {
    const double r = size * random_.uniform(0.12, 0.21);
    const Vector3d place = size * Vector3d(random_.uniform(-0.17, 0.17), random_.uniform(-0.17, 0.15),
                                           random_.uniform(-0.17, 0.17));
    Finish leaves = finish(Pattern::kFoliage, i % 2, Colour(1.1f, 1.1f, 1.f), 0.15f);
    leaves.grain = 0.4f;
    ellipsoid(crown + place, {r, 0.85 * r, r}, leaves);
  }
}

void Builder::lamp_post(const Vector3d& foot, double height) {
  const Finish metal = finish(Pattern::kPlain, 0, {0.33f, 0.36f, 0.34f});
  box(foot, {0.24, 0.9, 0.24}, 0, metal, metal);
  box(foot, {0.11, height, 0.11}, 0, metal, metal);
  box(foot - Vector3d(0, height, 0), {0.42, 0.5, 0.42}, 0, finish(Pattern::kWindow, 3, {1.3f, 1.3f, 1.2f}),
      metal);
}

void Builder::walker(const Vector3d& from, const Vector3d& to) {
  const auto colour = [this](double low, double high) {
    return Colour(random_.uniform(low, high), random_.uniform(low, high), random_.uniform(low, high));
  };
  Walker w;
  w.from = from;
  w.to = to;
  w.speed = random_.uniform(0.9, 1.5);
  w.phase = random_.uniform(0, 2.0 * (to - from).norm());
  w.height = random_.uniform(1.58, 1.88);
  w.skin =
      finish(Pattern::kPlain, 0, Colour(1.15f, 0.85f, 0.7f) * static_cast<float>(random_.uniform(0.5, 1.0)));
  w.coat = finish(Pattern::kCloth, static_cast<int>(random_.index(4)), colour(0.25, 1.3));
  w.trousers = finish(Pattern::kCloth, 4, colour(0.2, 0.7));
  world_.walkers.push_back(w);
}

}  // namespace raysfm::synth
