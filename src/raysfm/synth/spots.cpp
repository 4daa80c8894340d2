#include "raysfm/synth/spots.h"

#include <algorithm>
#include <cmath>

namespace raysfm::synth {

Paint paint_of(const World& world, const Finish& finish, float width, float height) {
  const Texture& texture = world.materials->texture(finish.texture);
  const bool fitted = finish.period == 0.f;
  return {1.f / (fitted ? width : finish.period),
          1.f / (fitted ? height : finish.period),
          fitted ? 0.f : finish.shift_u,
          fitted ? 0.f : finish.shift_v,
          finish.shift_v,
          finish.shift_u,
          finish.tint.x(),
          finish.tint.y(),
          finish.tint.z(),
          finish.stains,
          finish.grain,
          static_cast<int32_t>(texture.first_texel()),
          texture.side_log2()};
}

void place_on_ellipsoid(const World& world, const Scene& scene, const SightRow& sights, int begin, int end,
                        Spots& spots, int to) {
  const RayRow& rays = sights.rays;
  const size_t number = static_cast<size_t>(sights.surface[begin]) - scene.quads().size();
  const TracedEllipsoid& e = scene.ellipsoids()[number];
  const Eigen::Map<const Eigen::Matrix<float, 3, 3, Eigen::RowMajor>> to_unit(e.to_unit);
  for (int i = begin; i < end; ++i, ++to) {
    const Eigen::Vector3f direction(rays.dx[i], rays.dy[i], rays.dz[i]);
    const Eigen::Vector3f x = Eigen::Vector3f(rays.sx[i], rays.sy[i], rays.sz[i]) +
                              sights.distance[i] * direction - Eigen::Vector3f(e.centre);
    const Eigen::Vector3f p = to_unit * x;
    const Eigen::Vector3f normal = (to_unit.transpose() * p).normalized();
    const float across = sights.distance[i] * sights.spread[i];
    const float stretch = across / std::max(std::abs(normal.dot(direction)), 0.2f);
    const float radius = x.norm();
    // Longitude and latitude, as lengths on a sphere of the local radius.
    spots.u[to] = radius * std::atan2(p.x(), -p.z());
    spots.v[to] = radius * std::asin(std::clamp(p.y(), -1.f, 1.f));
    spots.along_u[to] = stretch, spots.along_v[to] = 0.f;
    spots.across_u[to] = 0.f, spots.across_v[to] = across;
    spots.light[to] = world.light.on(normal);
  }
}

}  // namespace raysfm::synth
