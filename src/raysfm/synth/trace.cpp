// Nearest surface along each ray, a pack of rays at a time.

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "raysfm/synth/trace.cpp"
#include <hwy/foreach_target.h>  // must come before highway.h

#include <hwy/highway.h>

#include "raysfm/synth/scene.h"

HWY_BEFORE_NAMESPACE();
namespace raysfm::synth::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<float, kRayPack>;
using V = hn::Vec<D>;
using M = hn::Mask<D>;
constexpr D d;

constexpr float kFar = 1e30f;
constexpr float kNear = 1e-3f;  // metres; a surface nearer than this is not seen
constexpr int kDepth = 64;      // of the stack; halving 2^31 surfaces needs 31

// Products are rounded before they are added, on every instruction set, so that all give the same image.
struct Vec3 {
  V x, y, z;
};
HWY_INLINE V dot(const float* a, const Vec3& b) {
  return hn::Add(hn::Add(hn::Mul(hn::Set(d, a[0]), b.x), hn::Mul(hn::Set(d, a[1]), b.y)),
                 hn::Mul(hn::Set(d, a[2]), b.z));
}
HWY_INLINE V dot(const Vec3& a, const Vec3& b) {
  return hn::Add(hn::Add(hn::Mul(a.x, b.x), hn::Mul(a.y, b.y)), hn::Mul(a.z, b.z));
}

struct Rays {
  Vec3 start, direction, inverse;
  V distance;  // of the nearest hit so far
  hn::VFromD<hn::RebindToSigned<D>> surface;
};

HWY_INLINE V safe_inverse(V x) {
  const V tiny = hn::Set(d, 1e-20f);
  const V away = hn::IfThenElse(hn::Lt(hn::Abs(x), tiny), tiny, x);
  return hn::Div(hn::Set(d, 1.f), away);
}

HWY_INLINE bool meets(const BoxNode& node, const Rays& r) {
  V from = hn::Zero(d), to = r.distance;
  const auto slab = [&](int axis, V start, V inverse) HWY_ATTR {
    const V a = hn::Mul(hn::Sub(hn::Set(d, node.low[axis]), start), inverse);
    const V b = hn::Mul(hn::Sub(hn::Set(d, node.high[axis]), start), inverse);
    from = hn::Max(from, hn::Min(a, b));
    to = hn::Min(to, hn::Max(a, b));
  };
  slab(0, r.start.x, r.inverse.x);
  slab(1, r.start.y, r.inverse.y);
  slab(2, r.start.z, r.inverse.z);
  return !hn::AllFalse(d, hn::Le(from, to));
}

HWY_INLINE void keep_nearest(Rays& r, V distance, M hit, int32_t surface) {
  const hn::RebindToSigned<D> di;
  hit = hn::And(hit, hn::And(hn::Gt(distance, hn::Set(d, kNear)), hn::Lt(distance, r.distance)));
  r.distance = hn::IfThenElse(hit, distance, r.distance);
  r.surface = hn::IfThenElse(hn::RebindMask(di, hit), hn::Set(di, surface), r.surface);
}

HWY_INLINE void meet(const TracedQuad& q, int32_t surface, Rays& r) {
  const V toward = dot(q.normal, r.direction);
  const V distance = hn::Div(hn::Sub(hn::Set(d, q.offset), dot(q.normal, r.start)), toward);
  const Vec3 x = {hn::Add(r.start.x, hn::Mul(distance, r.direction.x)),
                  hn::Add(r.start.y, hn::Mul(distance, r.direction.y)),
                  hn::Add(r.start.z, hn::Mul(distance, r.direction.z))};
  const V u = hn::Add(dot(q.right, x), hn::Set(d, q.right0));
  const V v = hn::Add(dot(q.down, x), hn::Set(d, q.down0));
  const V zero = hn::Zero(d);
  const M inside = hn::And(hn::And(hn::Ge(u, zero), hn::Le(u, hn::Set(d, q.width))),
                           hn::And(hn::Ge(v, zero), hn::Le(v, hn::Set(d, q.height))));
  keep_nearest(r, distance, inside, surface);
}

HWY_INLINE void meet(const TracedEllipsoid& e, int32_t surface, Rays& r) {
  const Vec3 from = {hn::Sub(r.start.x, hn::Set(d, e.centre[0])), hn::Sub(r.start.y, hn::Set(d, e.centre[1])),
                     hn::Sub(r.start.z, hn::Set(d, e.centre[2]))};
  const Vec3 s = {dot(e.to_unit, from), dot(e.to_unit + 3, from), dot(e.to_unit + 6, from)};
  const Vec3 w = {dot(e.to_unit, r.direction), dot(e.to_unit + 3, r.direction),
                  dot(e.to_unit + 6, r.direction)};
  // |s + t w| = 1, by way of the point of the line nearest to the centre, which keeps its digits from afar.
  const V ww = dot(w, w);
  const V middle = hn::Neg(hn::Div(dot(s, w), ww));
  const Vec3 p = {hn::Add(s.x, hn::Mul(middle, w.x)), hn::Add(s.y, hn::Mul(middle, w.y)),
                  hn::Add(s.z, hn::Mul(middle, w.z))};
  const V room = hn::Sub(hn::Set(d, 1.f), dot(p, p));
  const V half = hn::Sqrt(hn::Div(hn::Max(room, hn::Zero(d)), ww));
  keep_nearest(r, hn::Sub(middle, half), hn::Ge(room, hn::Zero(d)), surface);
}

void trace_pack(const Scene& scene, Rays& r) {
  const BoxNode* nodes = scene.nodes().data();
  const int32_t* order = scene.order().data();
  const TracedQuad* quads = scene.quads().data();
  const TracedEllipsoid* ellipsoids = scene.ellipsoids().data();
  const int32_t quad_count = static_cast<int32_t>(scene.quads().size());
  const bool backward[3] = {hn::GetLane(r.direction.x) < 0, hn::GetLane(r.direction.y) < 0,
                            hn::GetLane(r.direction.z) < 0};
  int32_t stack[kDepth];
  int depth = 0;
  stack[depth++] = 0;
  while (depth > 0) {
    const int32_t number = stack[--depth];
    const BoxNode& node = nodes[number];
    if (!meets(node, r)) continue;
    if (node.count == 0) {
      const bool flip = backward[node.axis];
      stack[depth++] = flip ? number + 1 : node.first;
      stack[depth++] = flip ? node.first : number + 1;
      continue;
    }
    for (int32_t i = node.first; i < node.first + node.count; ++i) {
      const int32_t surface = order[i];
      if (surface < quad_count) {
        meet(quads[surface], surface, r);
      } else {
        meet(ellipsoids[surface - quad_count], surface, r);
      }
    }
  }
}

void trace_row(const Scene& scene, const RayRow& rays, float* distance, int32_t* surface) {
  const hn::RebindToSigned<D> di;
  for (int i = 0; i < rays.count; i += static_cast<int>(hn::Lanes(d))) {
    Rays r;
    r.start = {hn::LoadU(d, rays.sx + i), hn::LoadU(d, rays.sy + i), hn::LoadU(d, rays.sz + i)};
    r.direction = {hn::LoadU(d, rays.dx + i), hn::LoadU(d, rays.dy + i), hn::LoadU(d, rays.dz + i)};
    r.inverse = {safe_inverse(r.direction.x), safe_inverse(r.direction.y), safe_inverse(r.direction.z)};
    const M blind = hn::Eq(dot(r.direction, r.direction), hn::Zero(d));
    r.distance = hn::IfThenElse(blind, hn::Zero(d), hn::Set(d, kFar));
    r.surface = hn::Set(di, -1);
    trace_pack(scene, r);
    hn::StoreU(r.distance, d, distance + i);
    hn::StoreU(r.surface, di, surface + i);
  }
}

}  // namespace raysfm::synth::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace raysfm::synth {

HWY_EXPORT(trace_row);

void Scene::trace(const RayRow& rays, float* distance, int32_t* surface) const {
  if (nodes_.empty()) {
    std::fill_n(distance, rays.count, 0.f);
    std::fill_n(surface, rays.count, -1);
    return;
  }
  HWY_DYNAMIC_DISPATCH(trace_row)(*this, rays, distance, surface);
}

}  // namespace raysfm::synth
#endif
