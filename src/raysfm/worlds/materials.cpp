#include "raysfm/worlds/materials.h"

#include <algorithm>
#include <cmath>

#include "raysfm/worlds/paint.h"
#include "raysfm/worlds/pattern.h"

namespace raysfm::synth {

float period_of(Pattern pattern) {
  switch (pattern) {
    case Pattern::kPlain:
    case Pattern::kBrick:
    case Pattern::kAshlar:
    case Pattern::kPlaster:
    case Pattern::kPaving:
    case Pattern::kAsphalt:
      return 4.f;
    case Pattern::kPlanks:
    case Pattern::kCobbles:
    case Pattern::kTiles:
    case Pattern::kFoliage:
      return 2.f;
    case Pattern::kCloth:
      return 1.f;
    case Pattern::kCheckerboard:
      return 0.2f;
    default:
      return 0.f;
  }
}

MaterialLibrary::MaterialLibrary(ThreadPool& pool)
    : pool_(pool), store_(std::make_shared<TexelStore>()), noise_(make_noise_texture(7, pool, store_)) {}

int MaterialLibrary::find(Pattern pattern, int variant) {
  const auto [entry, is_new] = numbers_.try_emplace({pattern, variant}, static_cast<int>(textures_.size()));
  if (is_new) {
    const auto [side, paint] = painter(pattern, variant, noise_);
    textures_.emplace_back(side, paint, pool_, store_);
  }
  return entry->second;
}

}  // namespace raysfm::synth
