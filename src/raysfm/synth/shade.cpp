// Colours of what rays meet, several rays at a time.
//
// A row is cut into stretches of rays that meet the same surface. Vectors begin at the first ray of a stretch
// and run over its end: what they write there is overwritten by the next stretch.

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "raysfm/synth/shade.cpp"
#include <hwy/foreach_target.h>  // must come before highway.h

#include <hwy/highway.h>

#include <algorithm>
#include <memory>

#include "raysfm/synth/shade.h"
#include "raysfm/synth/spots.h"

HWY_BEFORE_NAMESPACE();
namespace raysfm::synth::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<float, kRayPack>;
using DI = hn::RebindToSigned<D>;
using V = hn::Vec<D>;
using VI = hn::Vec<DI>;
constexpr D d;
constexpr DI di;

HWY_INLINE V set(float x) {
  return hn::Set(d, x);
}
HWY_INLINE V dot(const float* a, V x, V y, V z) {
  return hn::Add(hn::Add(hn::Mul(set(a[0]), x), hn::Mul(set(a[1]), y)), hn::Mul(set(a[2]), z));
}

// floor(x) for |x| < 2^31.
HWY_INLINE VI floor_of(V x) {
  const VI truncated = hn::ConvertTo(di, x);
  return hn::Add(truncated, hn::VecFromMask(di, hn::RebindMask(di, hn::Gt(hn::ConvertTo(d, truncated), x))));
}

// Levels of the pyramid to read: `below` and the one above it, which counts for `weight`.
struct Level {
  VI below;
  V weight;
};
HWY_INLINE Level level_of(V texels, VI side_log2) {
  // Continuous, piecewise linear stand-in for log2.
  const VI bits = hn::BitCast(di, hn::Max(texels, set(1.f)));
  const V log2 = hn::Add(hn::ConvertTo(d, hn::Sub(hn::ShiftRight<23>(bits), hn::Set(di, 127))),
                         hn::Mul(hn::ConvertTo(d, hn::And(bits, hn::Set(di, 0x7fffff))), set(0x1p-23f)));
  const V level = hn::Min(log2, hn::ConvertTo(d, side_log2));
  const VI highest = hn::Max(hn::Sub(side_log2, hn::Set(di, 1)), hn::Zero(di));
  const VI below = hn::Min(hn::Max(hn::ConvertTo(di, level), hn::Zero(di)), highest);
  return {below, hn::Sub(level, hn::ConvertTo(d, below))};
}

// The four texels around a place and their weights, which sum to 256.
struct Corners {
  VI texel[4], weight[4];
};
HWY_INLINE Corners corners(const int32_t* texels, VI first, VI side_log2, VI level, VI x, VI y) {
  const VI one = hn::Set(di, 1), low = hn::Set(di, 255), shift = hn::Sub(side_log2, level);
  const VI side = one << side_log2, n = one << shift, mask = hn::Sub(n, one);
  // Texels before the level: 4 / 3 (side^2 - n^2); a multiple of 3 is divided by the inverse of 3 modulo
  // 2^32.
  const VI all = hn::ShiftLeft<2>(hn::Sub(hn::Mul(side, side), hn::Mul(n, n)));
  const VI base = hn::Add(first, hn::Mul(all, hn::Set(di, static_cast<int32_t>(0xaaaaaaabu))));
  x = hn::Sub(x >> level, hn::Set(di, 128));  // from the centre of texel 0
  y = hn::Sub(y >> level, hn::Set(di, 128));
  const VI x0 = hn::And(hn::ShiftRight<8>(x), mask), x1 = hn::And(hn::Add(x0, one), mask);
  const VI y0 = hn::And(hn::ShiftRight<8>(y), mask), y1 = hn::And(hn::Add(y0, one), mask);
  const VI row0 = hn::Add(base, y0 << shift), row1 = hn::Add(base, y1 << shift);
  const VI wx = hn::And(x, low), wy = hn::And(y, low);
  const VI w11 = hn::ShiftRight<8>(hn::Add(hn::Mul(wx, wy), hn::Set(di, 128)));
  const VI w01 = hn::Sub(wx, w11), w10 = hn::Sub(wy, w11);
  const VI w00 = hn::Sub(hn::Sub(hn::Set(di, 256), wx), w10);
  return {{hn::GatherIndex(di, texels, hn::Add(row0, x0)), hn::GatherIndex(di, texels, hn::Add(row0, x1)),
           hn::GatherIndex(di, texels, hn::Add(row1, x0)), hn::GatherIndex(di, texels, hn::Add(row1, x1))},
          {w00, w01, w10, w11}};
}

// Weighted sum of two channels, those in the lower byte of each half of a lane after a shift to the right.
// Below 2^16 in each half.
template <int kShift>
HWY_INLINE VI blend(const Corners& c) {
  VI sum = hn::Zero(di);
  for (int i = 0; i < 4; ++i) {
    const VI channels = hn::And(hn::ShiftRight<kShift>(c.texel[i]), hn::Set(di, 0x00ff00ff));
    sum = hn::Add(sum, hn::Mul(channels, c.weight[i]));
  }
  return sum;
}
HWY_INLINE V lower_half(VI x) {
  return hn::ConvertTo(d, hn::And(x, hn::Set(di, 0xffff)));
}
HWY_INLINE V upper_half(VI x) {
  return hn::ConvertTo(d, hn::And(hn::ShiftRight<16>(x), hn::Set(di, 0xffff)));
}

struct Colours {
  V red, green, blue;
};

// See Texture::sample. (u, v): periods; `side`: texels per period.
HWY_INLINE Colours sample(const int32_t* texels, VI first, VI side_log2, V side, const Level& level, V u,
                          V v) {
  const V scale = hn::Mul(set(256.f), side), unit = set(1.f / 256.f);
  const VI x = floor_of(hn::Mul(scale, u)), y = floor_of(hn::Mul(scale, v));
  const Corners near = corners(texels, first, side_log2, level.below, x, y);
  const V weight = hn::Mul(hn::Sub(set(1.f), level.weight), unit);
  const VI red_blue = blend<0>(near), green = blend<8>(near);
  Colours c = {hn::Mul(weight, lower_half(red_blue)), hn::Mul(weight, lower_half(green)),
               hn::Mul(weight, upper_half(red_blue))};
  if (hn::AllTrue(d, hn::Le(level.weight, hn::Zero(d)))) return c;
  const VI above = hn::Min(hn::Add(level.below, hn::Set(di, 1)), side_log2);
  const Corners far = corners(texels, first, side_log2, above, x, y);
  const V weight2 = hn::Mul(level.weight, unit);
  const VI red_blue2 = blend<0>(far), green2 = blend<8>(far);
  c.red = hn::Add(c.red, hn::Mul(weight2, lower_half(red_blue2)));
  c.green = hn::Add(c.green, hn::Mul(weight2, lower_half(green2)));
  c.blue = hn::Add(c.blue, hn::Mul(weight2, upper_half(red_blue2)));
  return c;
}

// One channel of the noise texture, 0: red or 1: green.
template <int kChannel>
HWY_INLINE V sample_noise(const MaterialLibrary& materials, V u, V v, V footprint) {
  const Texture& noise = materials.noise();
  const int32_t* texels = reinterpret_cast<const int32_t*>(materials.texels().data());
  const VI side_log2 = hn::Set(di, noise.side_log2()), first = hn::Set(di, 0);
  const V side = set(static_cast<float>(1 << noise.side_log2())), unit = set(1.f / 256.f);
  const Level level = level_of(hn::Mul(footprint, side), side_log2);
  const V scale = hn::Mul(set(256.f), side);
  const VI x = floor_of(hn::Mul(scale, u)), y = floor_of(hn::Mul(scale, v));
  const V near = lower_half(blend<8 * kChannel>(corners(texels, first, side_log2, level.below, x, y)));
  V value = hn::Mul(hn::Mul(hn::Sub(set(1.f), level.weight), unit), near);
  if (hn::AllTrue(d, hn::Le(level.weight, hn::Zero(d)))) return value;
  const VI above = hn::Add(level.below, hn::Set(di, 1));
  const V far = lower_half(blend<8 * kChannel>(corners(texels, first, side_log2, above, x, y)));
  return hn::Add(value, hn::Mul(hn::Mul(level.weight, unit), far));
}

// Where the rays [begin, end) of a row meet one quad; `to` is the place of `begin` among the spots.
void place_on_quad(const TracedQuad& q, float light, const SightRow& s, int begin, int end, Spots& spots,
                   int to) {
  for (int i = begin; i < end; i += static_cast<int>(hn::Lanes(d)), to += static_cast<int>(hn::Lanes(d))) {
    const V distance = hn::LoadU(d, s.distance + i);
    const V dx = hn::LoadU(d, s.rays.dx + i), dy = hn::LoadU(d, s.rays.dy + i),
            dz = hn::LoadU(d, s.rays.dz + i);
    const V x = hn::Add(hn::LoadU(d, s.rays.sx + i), hn::Mul(distance, dx));
    const V y = hn::Add(hn::LoadU(d, s.rays.sy + i), hn::Mul(distance, dy));
    const V z = hn::Add(hn::LoadU(d, s.rays.sz + i), hn::Mul(distance, dz));
    const V facing = hn::Max(hn::Abs(dot(q.normal, dx, dy, dz)), set(0.02f));
    const V du = dot(q.right, dx, dy, dz), dv = dot(q.down, dx, dy, dz);
    const V slant = hn::Sqrt(hn::Add(hn::Mul(du, du), hn::Mul(dv, dv)));
    const auto square_on = hn::Lt(slant, set(1e-4f));  // any direction will do
    const V unit_u = hn::IfThenElse(square_on, set(1.f), hn::Div(du, slant));
    const V unit_v = hn::IfThenElse(square_on, set(0.f), hn::Div(dv, slant));
    const V across = hn::Mul(distance, hn::LoadU(d, s.spread + i)), along = hn::Div(across, facing);
    hn::StoreU(hn::Add(dot(q.right, x, y, z), set(q.right0)), d, spots.u + to);
    hn::StoreU(hn::Add(dot(q.down, x, y, z), set(q.down0)), d, spots.v + to);
    hn::StoreU(hn::Mul(along, unit_u), d, spots.along_u + to);
    hn::StoreU(hn::Mul(along, unit_v), d, spots.along_v + to);
    hn::StoreU(hn::Neg(hn::Mul(across, unit_v)), d, spots.across_u + to);
    hn::StoreU(hn::Mul(across, unit_u), d, spots.across_v + to);
    hn::StoreU(set(light), d, spots.light + to);
  }
}

void fill_paint(const Paint& p, int begin, int end, Spots& spots) {
  for (int i = begin; i < end; i += static_cast<int>(hn::Lanes(d))) {
    hn::StoreU(set(p.per_u), d, spots.per_u + i);
    hn::StoreU(set(p.per_v), d, spots.per_v + i);
    hn::StoreU(set(p.begin_u), d, spots.begin_u + i);
    hn::StoreU(set(p.begin_v), d, spots.begin_v + i);
    hn::StoreU(set(p.noise_u), d, spots.noise_u + i);
    hn::StoreU(set(p.noise_v), d, spots.noise_v + i);
    hn::StoreU(set(p.red), d, spots.red + i);
    hn::StoreU(set(p.green), d, spots.green + i);
    hn::StoreU(set(p.blue), d, spots.blue + i);
    hn::StoreU(set(p.stains), d, spots.stains + i);
    hn::StoreU(set(p.grain), d, spots.grain + i);
    hn::StoreU(hn::Set(di, p.first_texel), di, spots.first_texel + i);
    hn::StoreU(hn::Set(di, p.side_log2), di, spots.side_log2 + i);
  }
}

// Weathering, a factor about 1.
HWY_INLINE V weather(const MaterialLibrary& materials, const Spots& s, int i, V along) {
  const V stains = hn::LoadU(d, s.stains + i), grain = hn::LoadU(d, s.grain + i), one = set(1.f);
  const V u = hn::LoadU(d, s.u + i), v = hn::LoadU(d, s.v + i);
  const V begin_u = hn::LoadU(d, s.noise_u + i), begin_v = hn::LoadU(d, s.noise_v + i);
  const auto place = [&](V x, V begin, float period)
                         HWY_ATTR { return hn::Add(hn::Mul(x, set(1.f / period)), begin); };
  const V stain = sample_noise<0>(materials, place(u, begin_u, kStainPeriod), place(v, begin_v, kStainPeriod),
                                  hn::Mul(along, set(1.f / kStainPeriod)));
  const V speck = sample_noise<1>(materials, place(u, begin_u, kGrainPeriod), place(v, begin_v, kGrainPeriod),
                                  hn::Mul(along, set(1.f / kGrainPeriod)));
  const auto factor = [&](V strength, V noise) HWY_ATTR {
    return hn::Add(one, hn::Mul(strength, hn::Sub(hn::Mul(noise, set(1.f / 127.5f)), one)));
  };
  return hn::Mul(factor(stains, stain), factor(grain, speck));
}

// Colours of the spots [begin, end) of the row's stretch that begins at `to`.
void paint(const MaterialLibrary& materials, const Spots& s, int begin, int end, const ColourRow& out,
           int to) {
  const int32_t* texels = reinterpret_cast<const int32_t*>(materials.texels().data());
  const auto length = [](V a, V b) HWY_ATTR { return hn::Sqrt(hn::Add(hn::Mul(a, a), hn::Mul(b, b))); };
  for (int i = begin; i < end; i += static_cast<int>(hn::Lanes(d)), to += static_cast<int>(hn::Lanes(d))) {
    const V per_u = hn::LoadU(d, s.per_u + i), per_v = hn::LoadU(d, s.per_v + i);
    const V along_u = hn::LoadU(d, s.along_u + i), along_v = hn::LoadU(d, s.along_v + i);
    // Several lookups along the longer diameter keep what a surface seen edge-on shows across it.
    const V a_u = hn::Mul(along_u, per_u), a_v = hn::Mul(along_v, per_v);
    const V b_u = hn::Mul(hn::LoadU(d, s.across_u + i), per_u),
            b_v = hn::Mul(hn::LoadU(d, s.across_v + i), per_v);
    const V a = length(a_u, a_v), b = length(b_u, b_v);
    const auto swap = hn::Gt(b, a);
    const V longer = hn::Max(a, b), shorter = hn::Min(a, b);
    const V step_u = hn::IfThenElse(swap, b_u, a_u), step_v = hn::IfThenElse(swap, b_v, a_v);
    const V ratio = hn::Min(hn::Div(longer, hn::Max(shorter, set(1e-12f))), set(kMostProbes));
    const VI probes = hn::Max(hn::ConvertTo(di, hn::Add(ratio, set(0.5f))), hn::Set(di, 1));
    const V share = hn::Div(set(1.f), hn::ConvertTo(d, probes));
    const V footprint = hn::Max(shorter, hn::Mul(longer, share));
    const V u = hn::Add(hn::Mul(hn::LoadU(d, s.u + i), per_u), hn::LoadU(d, s.begin_u + i));
    const V v = hn::Add(hn::Mul(hn::LoadU(d, s.v + i), per_v), hn::LoadU(d, s.begin_v + i));

    const VI first = hn::LoadU(di, s.first_texel + i), side_log2 = hn::LoadU(di, s.side_log2 + i);
    const V side = hn::ConvertTo(d, hn::Set(di, 1) << side_log2);
    const Level level = level_of(hn::Mul(footprint, side), side_log2);
    const int most = std::clamp(hn::GetLane(hn::MaxOfLanes(di, probes)), 1, static_cast<int>(kMostProbes));
    Colours sum = {hn::Zero(d), hn::Zero(d), hn::Zero(d)};
    for (int p = 0; p < most; ++p) {
      const V k = hn::Sub(hn::Mul(set(static_cast<float>(p) + 0.5f), share), set(0.5f));
      const Colours c = sample(texels, first, side_log2, side, level, hn::Add(u, hn::Mul(k, step_u)),
                               hn::Add(v, hn::Mul(k, step_v)));
      const auto counts = hn::RebindMask(d, hn::Gt(probes, hn::Set(di, p)));
      sum.red = hn::Add(sum.red, hn::IfThenElseZero(counts, c.red));
      sum.green = hn::Add(sum.green, hn::IfThenElseZero(counts, c.green));
      sum.blue = hn::Add(sum.blue, hn::IfThenElseZero(counts, c.blue));
    }
    const V gain = hn::Mul(hn::Mul(share, weather(materials, s, i, length(along_u, along_v))),
                           hn::LoadU(d, s.light + i));
    hn::StoreU(hn::Mul(hn::Mul(sum.red, hn::LoadU(d, s.red + i)), gain), d, out.red + to);
    hn::StoreU(hn::Mul(hn::Mul(sum.green, hn::LoadU(d, s.green + i)), gain), d, out.green + to);
    hn::StoreU(hn::Mul(hn::Mul(sum.blue, hn::LoadU(d, s.blue + i)), gain), d, out.blue + to);
  }
}

// Haze at the horizon, blue above, and clouds on a far ceiling. Black where the ray is zero or there is no
// sky.
void paint_sky(const World& world, const SightRow& s, int begin, int end, const ColourRow& out) {
  const V zero = hn::Zero(d), one = set(1.f);
  for (int i = begin; i < end; i += static_cast<int>(hn::Lanes(d))) {
    if (!world.open_air) {
      for (float* channel : {out.red, out.green, out.blue}) hn::StoreU(zero, d, channel + i);
      continue;
    }
    const V dx = hn::LoadU(d, s.rays.dx + i), dy = hn::LoadU(d, s.rays.dy + i),
            dz = hn::LoadU(d, s.rays.dz + i);
    const V up = hn::Max(hn::Neg(dy), zero);
    const V scale = hn::Div(set(0.12f), hn::Max(up, set(0.02f)));
    const V footprint =
        hn::Div(hn::Mul(hn::Mul(set(4.f), hn::LoadU(d, s.spread + i)), scale), hn::Max(up, set(0.02f)));
    const V cloud = sample_noise<0>(*world.materials, hn::Mul(dx, scale), hn::Mul(dz, scale), footprint);
    const V thick = hn::Min(hn::Max(hn::Mul(hn::Sub(cloud, set(120.f)), set(1.f / 70.f)), zero), one);
    const V cover = hn::IfThenElseZero(
        hn::Ge(up, set(0.02f)), hn::Mul(hn::Mul(thick, hn::Min(hn::Mul(set(4.f), up), one)), set(0.8f)));
    const auto seen = hn::Gt(dot(kOnes, hn::Abs(dx), hn::Abs(dy), hn::Abs(dz)), zero);
    const auto mix = [&](float haze, float blue, float white) HWY_ATTR {
      const V clear = hn::Add(hn::Mul(set(haze), hn::Sub(one, up)), hn::Mul(set(blue), up));
      return hn::IfThenElseZero(seen, hn::Add(clear, hn::Mul(hn::Sub(set(white), clear), cover)));
    };
    hn::StoreU(mix(205.f, 112.f, 243.f), d, out.red + i);
    hn::StoreU(mix(218.f, 156.f, 243.f), d, out.green + i);
    hn::StoreU(mix(232.f, 214.f, 240.f), d, out.blue + i);
  }
}

int end_of_stretch(const int32_t* surface, int begin, int end) {
  int i = begin + 1;
  while (i < end && surface[i] == surface[begin]) ++i;
  return i;
}

// Rays [begin, end) of a row, at most kTile of them.
void shade_tile(const World& world, const Scene& scene, const SightRow& sights, int begin, int end,
                Spots& spots, const ColourRow& out) {
  const int quads = static_cast<int>(scene.quads().size());
  for (int at = begin; at < end;) {
    if (sights.surface[at] < 0) {
      const int next = end_of_stretch(sights.surface, at, end);
      paint_sky(world, sights, at, next, out);
      at = next;
      continue;
    }
    const int first = at;  // of the surfaces up to the next sight of the sky
    while (at < end && sights.surface[at] >= 0) {
      const int surface = sights.surface[at], next = end_of_stretch(sights.surface, at, end);
      if (surface < quads) {
        const TracedQuad& quad = scene.quads()[static_cast<size_t>(surface)];
        place_on_quad(quad, scene.light(surface), sights, at, next, spots, at - first);
        fill_paint(paint_of(world, scene.finish(surface), quad.width, quad.height), at - first, next - first,
                   spots);
      } else {
        place_on_ellipsoid(world, scene, sights, at, next, spots, at - first);
        fill_paint(paint_of(world, scene.finish(surface), 1.f, 1.f), at - first, next - first, spots);
      }
      at = next;
    }
    paint(*world.materials, spots, 0, at - first, out, first);
  }
}

}  // namespace raysfm::synth::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace raysfm::synth {

HWY_EXPORT(shade_tile);

void shade(const World& world, const Scene& scene, const SightRow& sights, const ColourRow& colours) {
  thread_local const auto spots = std::make_unique<Spots>();
  const auto tile = HWY_DYNAMIC_DISPATCH(shade_tile);
  for (int begin = 0; begin < sights.rays.count; begin += kTile) {
    tile(world, scene, sights, begin, std::min(begin + kTile, sights.rays.count), *spots, colours);
  }
}

}  // namespace raysfm::synth
#endif
