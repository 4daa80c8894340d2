#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <vector>

#include "raysfm/core/thread_pool.h"

namespace raysfm::synth {

// Red, green, blue in grey levels [0, 255].
using Colour = Eigen::Array3f;

// Square periodic picture with its pyramid of halved sizes, so that a lookup can average over the part of the
// surface that one ray stands for. Coordinates are in periods: (0, 0) is the corner of texel (0, 0), (1, 1)
// the same corner one period on.
class Texture {
 public:
  // `side`: texels per period, a power of two in [4, 4096]. `paint(u, v)` is asked once at the centre of
  // every texel, in any order and from several threads; its colours are clamped to [0, 255].
  Texture(int side, const std::function<Colour(float u, float v)>& paint, ThreadPool& pool);

  // Mean colour around (u, v) over about `footprint` periods; bilinear within a level of the pyramid, linear
  // between levels.
  Colour sample(float u, float v, float footprint) const;

 private:
  // Red, blue, green, unused: 16 bits each, in 1/256 grey levels. (x, y): 1/256 texel of level 0.
  uint64_t bilinear(int level, int x, int y) const;

  int side_;
  int levels_;
  std::vector<uint32_t> texels_;  // levels one after the other, rows of 0x00bbggrr
  std::vector<uint32_t> first_;   // of each level
};

}  // namespace raysfm::synth
