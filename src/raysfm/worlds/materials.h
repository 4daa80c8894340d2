#pragma once

#include <deque>
#include <map>
#include <utility>

#include "raysfm/worlds/texture.h"

namespace raysfm::synth {

// What a surface can be painted with. The patterns are procedures of `variant`, any number; the same variant
// always looks the same.
enum class Pattern {
  kPlain,         // only the weathering laid over every surface
  kBrick,         // period 4 m
  kAshlar,        // stone blocks; 4 m
  kPlaster,       // 4 m
  kPlanks,        // upright; 2 m
  kPaving,        // slabs; 4 m
  kCobbles,       // 2 m
  kAsphalt,       // 4 m
  kFoliage,       // 2 m
  kCloth,         // 1 m
  kTiles,         // floor tiles; 2 m
  kCheckerboard,  // squares of 0.1 m; 0.2 m
  kWindow,        // from here on fitted to their surface
  kDoor,
  kSign,
  kShopFront,
  kBooks,
  kPainting,
  kRug,
  kShutter,
};

// Metres that one period of the pattern covers; 0: it is fitted to its surface.
float period_of(Pattern pattern);

// The textures in use; each is painted once, when first asked for.
class MaterialLibrary {
 public:
  explicit MaterialLibrary(ThreadPool& pool);

  // Number of the texture, for texture().
  int find(Pattern pattern, int variant);
  const Texture& texture(int number) const { return textures_[number]; }
  const Texture& noise() const { return noise_; }
  // The texels of all of them, the noise first.
  const TexelStore& texels() const { return *store_; }

 private:
  ThreadPool& pool_;
  std::shared_ptr<TexelStore> store_;
  Texture noise_;
  std::deque<Texture> textures_;
  std::map<std::pair<Pattern, int>, int> numbers_;
};

}  // namespace raysfm::synth
