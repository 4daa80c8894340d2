#include "raysfm/worlds/texture.h"

#include <algorithm>
#include <bit>
#include <cassert>
#include <cmath>
#include <utility>

namespace raysfm::synth {

namespace {

uint32_t pack(const Colour& colour) {
  const Eigen::Array3i c = (colour.max(0.f).min(255.f) + 0.5f).cast<int>();
  return static_cast<uint32_t>(c.x() | c.y() << 8 | c.z() << 16);
}

uint64_t spread(uint32_t texel) {
  return (texel | static_cast<uint64_t>(texel) << 24) & 0x00ff00ff00ff00ffULL;
}

uint32_t mean_of_four(uint32_t a, uint32_t b, uint32_t c, uint32_t d) {
  const uint64_t sum = spread(a) + spread(b) + spread(c) + spread(d) + 0x0002000200020002ULL;
  const uint64_t mean = (sum >> 2) & 0x00ff00ff00ff00ffULL;
  return static_cast<uint32_t>(mean | mean >> 24);
}

Colour unpack(uint64_t lanes, float scale) {
  return scale * Colour(static_cast<float>(lanes & 0xffff), static_cast<float>(lanes >> 32 & 0xffff),
                        static_cast<float>(lanes >> 16 & 0xffff));
}

// floor(x) for |x| < 2^31, without the slow library call.
int floor_of(float scaled) {
  const int truncated = static_cast<int>(scaled);
  return truncated - (static_cast<float>(truncated) > scaled);
}

// Continuous, piecewise linear stand-in for log2 of a positive number.
float rough_log2(float x) {
  const uint32_t bits = std::bit_cast<uint32_t>(x);
  return static_cast<float>(static_cast<int>(bits >> 23) - 127) +
         static_cast<float>(bits & 0x7fffff) * 0x1p-23f;
}

}  // namespace

Texture::Texture(int side, const std::function<Colour(float u, float v)>& paint, ThreadPool& pool,
                 std::shared_ptr<TexelStore> store)
    : side_(side),
      levels_(std::bit_width(static_cast<unsigned>(side))),
      first_(static_cast<uint32_t>(store->size())),
      store_(std::move(store)) {
  assert(side >= 4 && side <= 4096 && std::has_single_bit(static_cast<unsigned>(side)));
  store_->resize(first_ + offset(levels_));
  uint32_t* texels = store_->data() + first_;
  const float step = 1.f / static_cast<float>(side);
  pool.parallel_for(side, [&](int y) {
    for (int x = 0; x < side; ++x) {
      const Colour c = paint((static_cast<float>(x) + 0.5f) * step, (static_cast<float>(y) + 0.5f) * step);
      texels[static_cast<size_t>(y) * side + x] = pack(c);
    }
  });
  for (int level = 1; level < levels_; ++level) {
    const int n = side >> level;
    const uint32_t* fine = texels + offset(level - 1);
    uint32_t* coarse = texels + offset(level);
    for (int y = 0; y < n; ++y) {
      for (int x = 0; x < n; ++x) {
        const uint32_t* f = fine + (4 * n * y + 2 * x);
        coarse[y * n + x] = mean_of_four(f[0], f[1], f[2 * n], f[2 * n + 1]);
      }
    }
  }
}

uint32_t Texture::offset(int level) const {
  // The sum of side^2 / 4^i for i < level.
  const uint32_t all = static_cast<uint32_t>(side_) * side_;
  return level == levels_ ? (4 * all - 1) / 3 : (4 * all - 4 * (all >> (2 * level))) / 3;
}

inline uint64_t Texture::bilinear(int level, int x, int y) const {
  const int mask = (side_ >> level) - 1, shift = levels_ - 1 - level;
  x = (x >> level) - 128;  // from the centre of texel 0
  y = (y >> level) - 128;
  const int x0 = (x >> 8) & mask, x1 = (x0 + 1) & mask;
  const uint32_t* texels = store_->data() + first_ + offset(level);
  const uint32_t* row0 = texels + (((y >> 8) & mask) << shift);
  const uint32_t* row1 = texels + ((((y >> 8) + 1) & mask) << shift);
  const uint64_t wx = x & 255, wy = y & 255;
  const uint64_t w11 = (wx * wy + 128) >> 8;
  return spread(row0[x0]) * (256 - wx - wy + w11) + spread(row0[x1]) * (wx - w11) +
         spread(row1[x0]) * (wy - w11) + spread(row1[x1]) * w11;
}

Colour Texture::sample(float u, float v, float footprint) const {
  const float side = static_cast<float>(side_);
  const int x = floor_of(256.f * side * u), y = floor_of(256.f * side * v);
  const float texels = footprint * side;
  constexpr float kScale = 1.f / 256.f;
  if (!(texels > 1.f)) return unpack(bilinear(0, x, y), kScale);
  const float level = std::min(rough_log2(texels), static_cast<float>(levels_ - 1));
  const int below = std::min(static_cast<int>(level), levels_ - 2);
  const float weight = level - static_cast<float>(below);
  return unpack(bilinear(below, x, y), (1.f - weight) * kScale) +
         unpack(bilinear(below + 1, x, y), weight * kScale);
}

}  // namespace raysfm::synth
