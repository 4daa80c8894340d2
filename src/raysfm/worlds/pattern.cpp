#include "raysfm/worlds/pattern.h"

namespace raysfm::synth {

namespace {

float value_noise(float u, float v, int cells, uint32_t seed) {
  const Cell x(u, cells), y(v, cells);
  const int x1 = x.index + 1 == cells ? 0 : x.index + 1;
  const int y1 = y.index + 1 == cells ? 0 : y.index + 1;
  const float a = chance(x.index, y.index, seed), b = chance(x1, y.index, seed);
  const float c = chance(x.index, y1, seed), d = chance(x1, y1, seed);
  const float sx = x.position * x.position * (3.f - 2.f * x.position);
  const float sy = y.position * y.position * (3.f - 2.f * y.position);
  const float top = a + (b - a) * sx;
  return top + (c + (d - c) * sx - top) * sy;
}

}  // namespace

float fractal_noise(float u, float v, int first, int octaves, float gain, uint32_t seed) {
  float sum = 0.f, power = 0.f, amplitude = 1.f;
  for (int i = 0; i < octaves; ++i) {
    sum += amplitude * (value_noise(u, v, first << i, seed + static_cast<uint32_t>(i)) - 0.5f);
    power += amplitude * amplitude;
    amplitude *= gain;
  }
  return 0.5f + 0.8f * sum / std::sqrt(power);
}

Texture make_noise_texture(uint32_t seed, ThreadPool& pool, std::shared_ptr<TexelStore> store) {
  const auto paint = [seed](float u, float v) {
    return Colour(255.f * fractal_noise(u, v, 4, 7, 0.72f, seed),
                  255.f * fractal_noise(u, v, 8, 6, 0.80f, seed + 101),
                  255.f * fractal_noise(u, v, 16, 5, 0.85f, seed + 202));
  };
  return Texture(512, paint, pool, std::move(store));
}

}  // namespace raysfm::synth
