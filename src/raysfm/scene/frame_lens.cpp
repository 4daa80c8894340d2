#include "raysfm/scene/frame_lens.h"

#include <variant>

namespace raysfm {

FrameLens frame_lens(const Lens& lens, const RadialDistortion& radial) {
  FrameLens made;
  if (radial.none()) {
    made.camera.model = Pinhole{lens.fx, lens.fy, lens.cx, lens.cy};
  } else {
    made.camera.model = Radtan{lens.fx, lens.fy, lens.cx, lens.cy, radial.k1, radial.k2};
  }
  made.skew = lens.skew;
  return made;
}

std::optional<Lens> lens_of(const FrameLens& lens) {
  std::optional<Lens> made = lens_of(lens.camera);
  if (made) made->skew = lens.skew;
  return made;
}

std::optional<Lens> lens_of(const Camera& camera) {
  if (const auto* m = std::get_if<Pinhole>(&camera.model)) return Lens{m->fx, m->fy, m->cx, m->cy};
  if (const auto* m = std::get_if<Radtan>(&camera.model)) return Lens{m->fx, m->fy, m->cx, m->cy};
  return std::nullopt;
}

RadialDistortion radial_distortion_of(const Camera& camera) {
  const auto* m = std::get_if<Radtan>(&camera.model);
  return m ? RadialDistortion{m->k1, m->k2} : RadialDistortion{};
}

}  // namespace raysfm
