#include "raysfm/synth/shade.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace raysfm::synth {

namespace {

constexpr float kStainPeriod = 37.f;  // metres
constexpr float kGrainPeriod = 1.3f;
constexpr int kMostProbes = 6;

// A place on a surface, in metres along its two directions, and the part of the surface that the ray stands
// for: an ellipse whose two diameters are the steps `along`, the way the ray leans, and `across`.
struct Spot {
  float u, v;
  float along_u, along_v, across_u, across_v;
};

Colour paint(const World& world, const Finish& finish, const Spot& spot, float per_u, float per_v) {
  const MaterialLibrary& materials = *world.materials;
  const Texture& texture = materials.texture(finish.texture);
  // Several lookups along the longer diameter keep what a surface seen edge-on shows across it.
  float step_u = spot.along_u * per_u, step_v = spot.along_v * per_v;
  float longer = std::sqrt(step_u * step_u + step_v * step_v);
  float shorter = std::sqrt(spot.across_u * spot.across_u * per_u * per_u +
                            spot.across_v * spot.across_v * per_v * per_v);
  if (shorter > longer) {
    std::swap(shorter, longer);
    step_u = spot.across_u * per_u;
    step_v = spot.across_v * per_v;
  }
  const float ratio = std::min(longer / std::max(shorter, 1e-12f), static_cast<float>(kMostProbes));
  const int probes = std::max(static_cast<int>(ratio + 0.5f), 1);
  const float share = 1.f / static_cast<float>(probes);
  const float footprint = std::max(shorter, longer * share);
  const bool fitted = finish.period == 0.f;
  const float u = spot.u * per_u + (fitted ? 0.f : finish.shift_u),
              v = spot.v * per_v + (fitted ? 0.f : finish.shift_v);
  Colour colour = Colour::Zero();
  for (int i = 0; i < probes; ++i) {
    const float k = (static_cast<float>(i) + 0.5f) * share - 0.5f;
    colour += texture.sample(u + k * step_u, v + k * step_v, footprint);
  }
  colour *= share * finish.tint;
  if (finish.stains == 0.f && finish.grain == 0.f) return colour;

  const float along = std::sqrt(spot.along_u * spot.along_u + spot.along_v * spot.along_v);
  const auto noise = [&](float period, int channel) {
    return materials.noise().sample(spot.u / period + finish.shift_v, spot.v / period + finish.shift_u,
                                    along / period)[channel] /
               127.5f -
           1.f;
  };
  const float weather =
      (1.f + finish.stains * noise(kStainPeriod, 0)) * (1.f + finish.grain * noise(kGrainPeriod, 1));
  return colour * weather;
}

Colour shade_quad(const World& world, const Scene& scene, const Sight& sight) {
  const TracedQuad& q = scene.quads()[static_cast<size_t>(sight.surface)];
  const Eigen::Vector3f right(q.right), down(q.down), normal(q.normal);
  const Eigen::Vector3f x = sight.start + sight.distance * sight.direction;
  const float facing = std::max(std::abs(normal.dot(sight.direction)), 0.02f);
  float du = right.dot(sight.direction), dv = down.dot(sight.direction);
  float slant = std::sqrt(du * du + dv * dv);
  if (slant < 1e-4f) du = slant = 1.f, dv = 0.f;  // seen square on: any direction will do
  const float across = sight.distance * sight.spread / slant, along = across / facing;
  const Spot spot{
      right.dot(x) + q.right0, down.dot(x) + q.down0, along * du, along * dv, -across * dv, across * du};
  const Finish& finish = scene.finish(sight.surface);
  const bool fitted = finish.period == 0.f;
  const float per_u = 1.f / (fitted ? q.width : finish.period),
              per_v = 1.f / (fitted ? q.height : finish.period);
  return paint(world, finish, spot, per_u, per_v) * scene.light(sight.surface);
}

Colour shade_ellipsoid(const World& world, const Scene& scene, const Sight& sight) {
  const size_t number = static_cast<size_t>(sight.surface) - scene.quads().size();
  const TracedEllipsoid& e = scene.ellipsoids()[number];
  const Eigen::Map<const Eigen::Matrix<float, 3, 3, Eigen::RowMajor>> to_unit(e.to_unit);
  const Eigen::Vector3f x = sight.start + sight.distance * sight.direction - Eigen::Vector3f(e.centre);
  const Eigen::Vector3f p = to_unit * x;
  const Eigen::Vector3f normal = (to_unit.transpose() * p).normalized();
  const float across = sight.distance * sight.spread;
  const float stretch = across / std::max(std::abs(normal.dot(sight.direction)), 0.2f);
  const float radius = x.norm();
  // Longitude and latitude, as lengths on a sphere of the local radius.
  const float longitude = std::atan2(p.x(), -p.z()), latitude = std::asin(std::clamp(p.y(), -1.f, 1.f));
  const Spot spot{radius * longitude, radius * latitude, stretch, 0.f, 0.f, across};
  const Finish& finish = scene.finish(sight.surface);
  const float per = finish.period > 0.f ? 1.f / finish.period : 1.f;
  return paint(world, finish, spot, per, per) * world.light.on(normal);
}

// Haze at the horizon, blue above, and clouds on a far ceiling.
Colour sky(const World& world, const Eigen::Vector3f& direction, float spread) {
  const float up = std::max(-direction.y(), 0.f);
  Colour colour = Colour(205.f, 218.f, 232.f) * (1.f - up) + Colour(112.f, 156.f, 214.f) * up;
  if (up < 0.02f) return colour;
  const float scale = 0.12f / up;
  const float cloud = world.materials->noise().sample(direction.x() * scale, direction.z() * scale,
                                                      4.f * spread * scale / up)[0];
  const float cover = std::clamp((cloud - 120.f) / 70.f, 0.f, 1.f) * std::min(4.f * up, 1.f);
  return colour + (Colour(243.f, 243.f, 240.f) - colour) * (0.8f * cover);
}

}  // namespace

Colour shade(const World& world, const Scene& scene, const Sight& sight) {
  if (sight.surface < 0)
    return world.open_air ? sky(world, sight.direction, sight.spread) : Colour(Colour::Zero());
  if (static_cast<size_t>(sight.surface) < scene.quads().size()) return shade_quad(world, scene, sight);
  return shade_ellipsoid(world, scene, sight);
}

}  // namespace raysfm::synth
