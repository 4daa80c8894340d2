#include <algorithm>
#include <cmath>
#include <vector>

#include "raysfm/worlds/paint.h"
#include "raysfm/worlds/pattern.h"

namespace raysfm::synth {

namespace {

// Any colour, not too gaudy.
Colour vivid(int x, int y, uint32_t seed) {
  const Colour c(chance(x, y, seed), chance(x, y, seed + 1), chance(x, y, seed + 2));
  return 35.f + 190.f * (0.62f * c + 0.38f * c.mean());
}

float distance_to_border(float u, float v) {
  return std::min(std::min(u, 1.f - u), std::min(v, 1.f - v));
}

// Frame, glazing bars, curtains behind, and a reflection of the sky and of what stands opposite.
Colour window(float u, float v, uint32_t seed, const Texture& noise) {
  const int columns = 2 + static_cast<int>(hash(1, 0, seed) % 2),
            rows = 2 + static_cast<int>(hash(2, 0, seed) % 3);
  const Cell pane_u(u, columns), pane_v(v, rows);
  const float bar = std::min(std::min(pane_u.position, 1.f - pane_u.position) / static_cast<float>(columns),
                             std::min(pane_v.position, 1.f - pane_v.position) / static_cast<float>(rows));
  if (distance_to_border(u, v) < 0.07f || bar < 0.018f) {
    const Colour frame =
        chance(3, 0, seed) < 0.6f ? Colour(225.f, 222.f, 212.f) : Colour(vivid(3, 1, seed) * 0.7f);
    return frame + 50.f * speckle(noise, u, v, 2.f, 1);
  }
  const float curtain = std::abs(u - 0.5f) > 0.18f + 0.2f * chance(4, 0, seed) ? 70.f : 0.f;
  const float folds = curtain * (0.4f + 0.6f * std::abs(std::sin(60.f * u + 3.f * v)));
  const float reflection =
      60.f * smoothstep(-0.05f, 0.1f, speckle(noise, u + chance(5, 0, seed), v, 0.7f, 0));
  const float pane = 40.f * (chance(pane_u.index, pane_v.index, seed + 9) - 0.5f);
  return Colour(48.f, 58.f, 70.f) + folds + reflection * (1.2f - v) + pane +
         40.f * speckle(noise, u, v, 1.f, 1);
}

Colour door(float u, float v, uint32_t seed, const Texture& noise) {
  const Colour base = vivid(0, 0, seed) * 0.6f + 20.f;
  const float grain = 60.f * speckle(noise, 2.f * u, 0.5f * v, 2.f, 1);
  if (distance_to_border(u, v) < 0.05f) return Colour(200.f, 195.f, 185.f) + grain;
  if (std::hypot((u - 0.86f) * 0.5f, v - 0.52f) < 0.018f) return Colour(230.f, 210.f, 120.f);
  const Cell pu(u, 2), pv(v, 3);
  const float edge =
      std::min(std::min(pu.position, 1.f - pu.position), std::min(pv.position, 1.f - pv.position));
  const float relief = edge > 0.16f && edge < 0.20f ? -45.f : edge >= 0.20f && edge < 0.24f ? 30.f : 0.f;
  return base + relief + grain;
}

// Rows of made-up letters: each a 3 x 5 raster of strokes.
float lettering(float u, float v, int letters, int rows, uint32_t seed) {
  const Cell letter(u, letters), row(v, rows);
  if (letter.position < 0.12f || letter.position > 0.88f || row.position < 0.18f || row.position > 0.82f)
    return 0.f;
  if (chance(letter.index, row.index, seed + 5) < 0.15f) return 0.f;
  const int x = static_cast<int>((letter.position - 0.12f) / 0.76f * 3.f);
  const int y = static_cast<int>((row.position - 0.18f) / 0.64f * 5.f);
  return chance(16 * letter.index + x, 16 * row.index + y, seed) < 0.62f ? 1.f : 0.f;
}

Colour sign(float u, float v, uint32_t seed, const Texture& noise) {
  const Colour ground = vivid(0, 0, seed);
  const Colour ink = ground.mean() > 130.f ? Colour(25.f, 25.f, 30.f) : Colour(240.f, 236.f, 220.f);
  const float grain = 45.f * speckle(noise, u, v, 1.f, 1);
  const float border = distance_to_border(u, v);
  if (border > 0.035f && border < 0.055f) return ink + grain;
  const float text = lettering(u, v, 6 + static_cast<int>(hash(7, 0, seed) % 5), 1, seed);
  const float mark = border > 0.1f ? text : 0.f;
  return ground * (1.f - mark) + ink * mark + grain;
}

// Goods of all sizes behind glass.
Colour shop_front(float u, float v, uint32_t seed, const Texture& noise) {
  if (distance_to_border(u, v) < 0.025f || v > 0.86f) {
    return vivid(9, 0, seed) * 0.6f + 20.f + 50.f * speckle(noise, u, v, 2.f, 1);
  }
  Colour c = Colour(62.f, 58.f, 54.f) + 60.f * speckle(noise, u, v, 1.f, 0);
  for (int scale = 5; scale <= 20; scale *= 2) {
    const Cell x(u, scale), y(v, scale * 2 / 3);
    const uint32_t s = seed + static_cast<uint32_t>(scale);
    if (chance(x.index, y.index, s) > 0.45f) continue;
    const float w = 0.2f + 0.25f * chance(x.index, y.index, s + 1),
                h = 0.25f + 0.2f * chance(x.index, y.index, s + 2);
    const bool round = chance(x.index, y.index, s + 3) < 0.3f;
    const float dx = (x.position - 0.5f) / w, dy = (y.position - 0.5f) / h;
    if (round ? dx * dx + dy * dy < 1.f : std::max(std::abs(dx), std::abs(dy)) < 1.f)
      c = vivid(x.index, y.index, s + 4);
  }
  return c + 35.f * smoothstep(0.f, 0.1f, speckle(noise, u, v, 0.6f, 0)) +
         30.f * speckle(noise, u, v, 2.f, 1);
}

Colour books(float u, float v, uint32_t seed, const Texture& noise) {
  const int shelves = 5;
  const Cell shelf(v, shelves);
  const float grain = 40.f * speckle(noise, u, v, 2.f, 1);
  if (shelf.position > 0.9f || std::min(u, 1.f - u) < 0.02f) return Colour(120.f, 84.f, 54.f) + grain;
  const int row_seed = 37 * shelf.index;
  const float warp =
      u + 0.012f * std::sin(40.f * u + static_cast<float>(row_seed));  // books of unequal thickness
  const Cell book(std::clamp(warp, 0.f, 0.9999f), 26);
  const float top = 0.08f + 0.25f * chance(book.index, row_seed, seed);
  if (shelf.position < top) return Colour(34.f, 26.f, 22.f) + grain;
  const Colour cover = vivid(book.index, row_seed, seed + 3);
  const float edge = std::min(book.position, 1.f - book.position);
  const float band =
      chance(book.index, static_cast<int>(shelf.position * 14.f) + row_seed, seed + 6) < 0.25f ? 1.f : 0.f;
  return (cover * (1.f - 0.6f * band) + 150.f * band) * (edge < 0.08f ? 0.4f : 1.f) + grain;
}

// One of a painting: an ellipse or a box, turned.
struct Shape {
  float u, v, cos, sin;
  float size, other_size;  // halves of the axes
  bool round;
  Colour colour;
};

// The same for every texel.
struct Picture {
  Colour ground;
  float shift;
  std::vector<Shape> shapes;  // the last ones in front
};

Picture picture(uint32_t seed) {
  Picture out{vivid(0, 0, seed) * 0.5f + 90.f, chance(1, 0, seed), {}};
  for (int i = 0; i < 14; ++i) {
    const float angle = 6.28f * chance(i, 3, seed), size = 0.03f + 0.16f * chance(i, 4, seed);
    out.shapes.push_back({chance(i, 1, seed), chance(i, 2, seed), std::cos(angle), std::sin(angle), size,
                          size * (0.3f + 0.7f * chance(i, 5, seed)), chance(i, 6, seed) < 0.5f,
                          vivid(i, 7, seed)});
  }
  return out;
}

Colour painting(float u, float v, const Picture& picture, const Texture& noise) {
  if (distance_to_border(u, v) < 0.05f)
    return Colour(150.f, 118.f, 60.f) + 80.f * speckle(noise, u, v, 3.f, 1);
  Colour c = picture.ground + 130.f * speckle(noise, u + picture.shift, v, 0.5f, 0);
  for (const Shape& shape : picture.shapes) {
    const float du = u - shape.u, dv = v - shape.v;
    const float a = (du * shape.cos + dv * shape.sin) / shape.size;
    const float b = (dv * shape.cos - du * shape.sin) / shape.other_size;
    const bool inside = shape.round ? a * a + b * b < 1.f : std::max(std::abs(a), std::abs(b)) < 1.f;
    if (inside) c = shape.colour;
  }
  return c + 50.f * speckle(noise, u, v, 2.f, 1);
}

Colour rug(float u, float v, uint32_t seed, const Texture& noise) {
  const float border = distance_to_border(u, v);
  const float pile = 50.f * speckle(noise, u, v, 3.f, 1) + 50.f * speckle(noise, u, v, 1.f, 0);
  const int ring = static_cast<int>(border * 24.f);
  if (ring < 4) return vivid(ring, 0, seed) * 0.8f + pile;
  const Cell x(u, 14), y(v, 14);
  const float diamond = std::abs(x.position - 0.5f) + std::abs(y.position - 0.5f);
  const float size = 0.2f + 0.3f * chance(x.index, y.index, seed + 1);
  const Colour motif = vivid(x.index, y.index, seed + 2) * 0.8f;
  return (diamond < size ? motif : Colour(vivid(5, 5, seed) * 0.6f)) + pile;
}

Colour shutter(float u, float v, uint32_t seed, const Texture& noise) {
  const Cell slat(v, 18);
  const Colour base = vivid(0, 0, seed) * 0.5f + 60.f;
  const float shade = slat.position < 0.2f ? 0.55f : 0.85f + 0.3f * slat.position;
  const float graffiti =
      lettering(u * 1.5f + chance(1, 0, seed), v * 1.6f, 5, 2, seed) > 0.f && v > 0.4f ? 1.f : 0.f;
  return base * shade * (1.f - 0.6f * graffiti) + 60.f * graffiti + 60.f * speckle(noise, u, v, 1.f, 0) +
         40.f * speckle(noise, u, v, 3.f, 1);
}

}  // namespace

Painter fitted_painter(Pattern pattern, uint32_t seed, const Texture& noise) {
  const auto with = [seed, &noise](auto function) {
    return [=, &noise](float u, float v) { return function(u, v, seed, noise); };
  };
  switch (pattern) {
    case Pattern::kWindow:
      return {128, with(window)};
    case Pattern::kDoor:
      return {256, with(door)};
    case Pattern::kSign:
      return {256, with(sign)};
    case Pattern::kShopFront:
      return {512, with(shop_front)};
    case Pattern::kBooks:
      return {512, with(books)};
    case Pattern::kPainting:
      return {512, [what = picture(seed), &noise](float u, float v) { return painting(u, v, what, noise); }};
    case Pattern::kRug:
      return {512, with(rug)};
    default:
      return {256, with(shutter)};
  }
}

Painter painter(Pattern pattern, int variant, const Texture& noise) {
  const uint32_t seed = hash(static_cast<int>(pattern), variant, 11);
  return pattern < Pattern::kWindow ? repeating_painter(pattern, seed, noise)
                                    : fitted_painter(pattern, seed, noise);
}

}  // namespace raysfm::synth
