#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "raysfm/core/thread_pool.h"

namespace raysfm::synth {

// Red, green, blue in grey levels [0, 255].
using Colour = Eigen::Array3f;

// Texels of many textures one after the other, 0x00bbggrr, so that one lookup can read several of them.
using TexelStore = std::vector<uint32_t>;

// Square periodic picture with its pyramid of halved sizes, so that a lookup can average over the part of the
// surface that one ray stands for. Coordinates are in periods: (0, 0) is the corner of texel (0, 0), (1, 1)
// the same corner one period on.
class Texture {
 public:
  // `side`: texels per period, a power of two in [4, 4096]. `paint(u, v)` is asked once at the centre of
  // every texel, in any order and from several threads; its colours are clamped to [0, 255]. The texels are
  // appended to `store`.
  Texture(int side, const std::function<Colour(float u, float v)>& paint, ThreadPool& pool,
          std::shared_ptr<TexelStore> store = std::make_shared<TexelStore>());

  // Mean colour around (u, v) over about `footprint` periods; bilinear within a level of the pyramid, linear
  // between levels.
  Colour sample(float u, float v, float footprint) const;

  // Where it lies in the store: level 0 by rows, then the halved ones down to a single texel.
  uint32_t first_texel() const { return first_; }
  int side_log2() const { return levels_ - 1; }

 private:
  // Texels before the given level.
  uint32_t offset(int level) const;
  // Red, blue, green, unused: 16 bits each, in 1/256 grey levels. (x, y): 1/256 texel of level 0.
  uint64_t bilinear(int level, int x, int y) const;

  int side_;
  int levels_;
  uint32_t first_;
  std::shared_ptr<TexelStore> store_;
};

}  // namespace raysfm::synth
