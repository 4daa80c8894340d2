#include <algorithm>
#include <cmath>

#include "raysfm/worlds/paint.h"
#include "raysfm/worlds/pattern.h"

namespace raysfm::synth {

namespace {

// Noise in [-0.5, 0.5] of one channel, `times` periods over the pattern's own.
struct Bond {
  int courses;             // rows per period
  int units;               // per row and period
  float shift;             // of every second row, in units
  float joint_u, joint_v;  // half width of a joint in units and courses
};

// Masonry, paving and tiles: units in courses, each with its own tone, and joints between them.
Colour masonry(float u, float v, const Bond& bond, const Colour& unit, const Colour& joint, float variety,
               uint32_t seed, const Texture& noise) {
  const float wobble = 0.004f * speckle(noise, u, v, 2.f, 2);
  const Cell row(v + wobble, bond.courses);
  const float shift = (row.index % 2 ? bond.shift : 0.f) / static_cast<float>(bond.units);
  const Cell column(u + shift + wobble, bond.units);
  const float tone = chance(column.index, row.index, seed) - 0.5f;
  const float hue = chance(column.index, row.index, seed + 1) - 0.5f;
  const float edge = std::min(std::min(column.position, 1.f - column.position) / bond.joint_u,
                              std::min(row.position, 1.f - row.position) / bond.joint_v);
  const float inside = smoothstep(0.7f, 1.3f, edge + 0.8f * speckle(noise, u, v, 3.f, 1));
  const Colour face = unit * (1.f + variety * tone) * Colour(1.f + 0.12f * hue, 1.f, 1.f - 0.12f * hue);
  const float grain = 70.f * speckle(noise, u, v, 2.f, 1) + 45.f * speckle(noise, v, u, 5.f, 2);
  return joint * (1.f - inside) + face * inside + grain * (0.4f + 0.6f * inside);
}

Colour plaster(float u, float v, uint32_t seed, const Texture& noise) {
  const float stain = speckle(noise, u, v, 1.f, 0);
  const float patch = smoothstep(0.13f, 0.16f, speckle(noise, u + 0.3f, v, 1.f, 1));
  const float crack = smoothstep(0.012f, 0.f, std::abs(speckle(noise, v, u, 1.f, 0) + 0.02f));
  const float base = 176.f + 20.f * chance(0, 0, seed);
  return Colour::Constant(base + 50.f * stain + 50.f * speckle(noise, u, v, 4.f, 1) - 45.f * patch -
                          60.f * crack);
}

Colour planks(float u, float v, uint32_t seed, const Texture& noise) {
  const Cell plank(u, 14);
  const float tone = chance(plank.index, 3, seed) - 0.5f;
  const float lift = chance(plank.index, 4, seed);
  const float grain = noise.sample(6.f * u, v + lift, 0.f)[1] / 255.f - 0.5f;
  const float knots = smoothstep(0.2f, 0.3f, speckle(noise, 2.f * u, v + 2.f * lift, 1.f, 2));
  const float gap = smoothstep(0.f, 0.05f, std::min(plank.position, 1.f - plank.position));
  const float end = smoothstep(0.f, 0.006f, std::abs(Cell(v + lift, 1).position - 0.5f));
  return Colour(168.f, 124.f, 82.f) *
         ((1.f + 0.45f * tone + 0.9f * grain - 0.5f * knots) * (0.25f + 0.75f * gap * end));
}

// Distance to the nearest and second nearest seed point of a jittered lattice, and the nearest one's cell.
struct Nearest {
  float first = 9.f, second = 9.f;
  int x = 0, y = 0;
};

Nearest nearest_seed(float u, float v, int cells, uint32_t seed) {
  const Cell cx(u, cells), cy(v, cells);
  Nearest best;
  for (int dy = -1; dy <= 1; ++dy) {
    for (int dx = -1; dx <= 1; ++dx) {
      const int x = (cx.index + dx + cells) % cells, y = (cy.index + dy + cells) % cells;
      const float px = static_cast<float>(dx) + 0.15f + 0.7f * chance(x, y, seed) - cx.position;
      const float py = static_cast<float>(dy) + 0.15f + 0.7f * chance(x, y, seed + 1) - cy.position;
      const float distance = std::sqrt(px * px + py * py);
      if (distance < best.first) {
        best = {distance, best.first, x, y};
      } else {
        best.second = std::min(best.second, distance);
      }
    }
  }
  return best;
}

Colour cobbles(float u, float v, uint32_t seed, const Texture& noise) {
  const Nearest stone = nearest_seed(u, v, 16, seed);
  const float tone = chance(stone.x, stone.y, seed + 2) - 0.5f;
  const float inside = smoothstep(0.04f, 0.16f, stone.second - stone.first);
  return Colour(140.f, 134.f, 126.f) * (0.45f + 0.55f * inside) * (1.f + 0.6f * tone) +
         70.f * speckle(noise, u, v, 3.f, 1);
}

Colour asphalt(float u, float v, uint32_t seed, const Texture& noise) {
  const float repaired = smoothstep(0.10f, 0.12f, speckle(noise, u, v, 1.f, 0));
  const float crack = smoothstep(0.010f, 0.f, std::abs(speckle(noise, v + 0.5f, u, 1.f, 0)));
  const float stones = chance(static_cast<int>(512.f * u), static_cast<int>(512.f * v), seed) - 0.5f;
  return Colour(118.f, 117.f, 116.f) + 60.f * speckle(noise, u, v, 2.f, 1) + 60.f * stones - 30.f * repaired -
         55.f * crack;
}

Colour foliage(float u, float v, uint32_t seed, const Texture& noise) {
  const Nearest leaf = nearest_seed(u, v, 36, seed);
  const float tone = chance(leaf.x, leaf.y, seed + 2);
  const float depth = speckle(noise, u, v, 1.f, 1);
  const float light = (0.25f + 0.95f * tone) * smoothstep(0.75f, 0.15f, leaf.first) * (1.f + 1.4f * depth);
  return Colour(25.f, 38.f, 18.f) + Colour(104.f, 126.f, 66.f) * std::max(light, 0.f);
}

Colour cloth(float u, float v, uint32_t seed, const Texture& noise) {
  const Cell stripe(v, 4 + static_cast<int>(hash(0, 0, seed) % 7));
  const float tone = 0.75f + 0.5f * chance(stripe.index, 0, seed);
  return Colour::Constant(150.f * tone + 110.f * speckle(noise, u, v, 1.f, 0) +
                          60.f * speckle(noise, u, v, 3.f, 1));
}

// Two by two squares whose borders are borders of texels, so that bilinear lookup leaves every corner in
// place.
Colour checkerboard(float u, float v, uint32_t, const Texture&) {
  return Colour::Constant((u < 0.5f) == (v < 0.5f) ? 30.f : 225.f);
}

}  // namespace

Painter repeating_painter(Pattern pattern, uint32_t seed, const Texture& noise) {
  const auto with = [seed, &noise](auto function) {
    return [=, &noise](float u, float v) { return function(u, v, seed, noise); };
  };
  const auto bonded = [seed, &noise](const Bond& bond, const Colour& unit, const Colour& joint,
                                     float variety) {
    return [=, &noise](float u, float v) { return masonry(u, v, bond, unit, joint, variety, seed, noise); };
  };
  const float warm = chance(1, 1, seed);
  switch (pattern) {
    case Pattern::kBrick:
      return {512, bonded({48, 16, 0.5f, 0.035f, 0.12f}, {165.f + 20.f * warm, 98.f + 22.f * warm, 80.f},
                          {176.f, 168.f, 158.f}, 0.6f)};
    case Pattern::kAshlar:
      return {512, bonded({9, 6, 0.45f, 0.015f, 0.025f}, {182.f, 172.f, 150.f + 20.f * warm},
                          {96.f, 92.f, 84.f}, 0.35f)};
    case Pattern::kPaving:
      return {512, bonded({10, 7, 0.4f, 0.018f, 0.02f}, {156.f, 152.f, 144.f}, {84.f, 82.f, 78.f}, 0.4f)};
    case Pattern::kTiles:
      return {512, bonded({6, 6, 0.f, 0.015f, 0.015f}, {186.f, 176.f, 158.f}, {104.f, 98.f, 90.f}, 0.45f)};
    case Pattern::kPlaster:
      return {512, with(plaster)};
    case Pattern::kPlanks:
      return {512, with(planks)};
    case Pattern::kCobbles:
      return {512, with(cobbles)};
    case Pattern::kAsphalt:
      return {512, with(asphalt)};
    case Pattern::kFoliage:
      return {512, with(foliage)};
    case Pattern::kCloth:
      return {256, with(cloth)};
    case Pattern::kCheckerboard:
      return {256, with(checkerboard)};
    default:
      return {4, [](float, float) { return Colour::Constant(180.f); }};
  }
}

}  // namespace raysfm::synth
