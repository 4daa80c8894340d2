#include "raysfm/bundle/residual_kernels.h"

#include <cmath>

// Vectors without a size at compile time cannot be members of the small structs below.
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV)
#endif
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "raysfm/bundle/residual_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace raysfm {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using Tag = hn::CappedTag<double, kBundleLanes>;
using Vec = hn::Vec<Tag>;
using Mask = hn::Mask<Tag>;

// Products and sums are never fused: every target gives the same bits.

struct Vec3 {
  Vec x, y, z;
};

HWY_INLINE Vec dot(Vec a0, Vec b0, Vec a1, Vec b1) {
  return hn::Add(hn::Mul(a0, b0), hn::Mul(a1, b1));
}
HWY_INLINE Vec dot(const Vec3& a, const Vec3& b) {
  return hn::Add(dot(a.x, b.x, a.y, b.y), hn::Mul(a.z, b.z));
}
HWY_INLINE Vec3 Load3(const double (*from)[kBundleLanes], size_t lane) {
  const Tag d;
  return {hn::Load(d, from[0] + lane), hn::Load(d, from[1] + lane), hn::Load(d, from[2] + lane)};
}
HWY_INLINE Vec3 Set3(const double* v) {
  const Tag d;
  return {hn::Set(d, v[0]), hn::Set(d, v[1]), hn::Set(d, v[2])};
}

HWY_INLINE void StoreResidual(Mask valid, Vec r0, Vec r1, ResidualBlock* block, size_t lane) {
  const Tag d;
  hn::Store(r0, d, block->residual[0] + lane);
  hn::Store(r1, d, block->residual[1] + lane);
  const Vec squared = dot(r0, r0, r1, r1);
  hn::Store(hn::IfThenElse(valid, squared, hn::Set(d, HUGE_VAL)), d, block->squared + lane);
}

HWY_INLINE void StoreRow(const Vec3& row, double (*to)[kBundleLanes], size_t lane) {
  const Tag d;
  hn::Store(row.x, d, to[0] + lane);
  hn::Store(row.y, d, to[1] + lane);
  hn::Store(row.z, d, to[2] + lane);
}

// The row a of d pixel / d x_in_cam times the rotation.
HWY_INLINE Vec3 TimesRotation(const Vec3& a, const double* r) {
  const Tag d;
  const auto column = [&](int c) HWY_ATTR {
    return dot(a, {hn::Set(d, r[c]), hn::Set(d, r[3 + c]), hn::Set(d, r[6 + c])});
  };
  return {column(0), column(1), column(2)};
}

void PinholeResiduals(const PinholeInRig& camera, const double* u, const double* v, ResidualBlock* block) {
  const Tag d;
  const double* r = camera.rotation;
  const Vec fx = hn::Set(d, camera.fx), fy = hn::Set(d, camera.fy), zero = hn::Zero(d);
  const Vec limit = hn::Set(d, Pinhole::kMaxRadius * Pinhole::kMaxRadius);
  for (size_t lane = 0; lane < kBundleLanes; lane += hn::Lanes(d)) {
    const Vec3 rig = Load3(block->x, lane);
    const Vec px = hn::Add(dot(Set3(r), rig), hn::Set(d, camera.translation[0]));
    const Vec py = hn::Add(dot(Set3(r + 3), rig), hn::Set(d, camera.translation[1]));
    const Vec pz = hn::Add(dot(Set3(r + 6), rig), hn::Set(d, camera.translation[2]));
    const Vec inverse = hn::Div(hn::Set(d, 1.0), pz);
    const Vec x = hn::Mul(px, inverse), y = hn::Mul(py, inverse);
    const Mask valid = hn::And(hn::Gt(pz, zero), hn::Lt(dot(x, x, y, y), limit));
    const Vec r0 = hn::Sub(hn::Add(hn::Mul(fx, x), hn::Set(d, camera.cx)), hn::LoadU(d, u + lane));
    const Vec r1 = hn::Sub(hn::Add(hn::Mul(fy, y), hn::Set(d, camera.cy)), hn::LoadU(d, v + lane));
    StoreResidual(valid, r0, r1, block, lane);
    const Vec fx_z = hn::Mul(fx, inverse), fy_z = hn::Mul(fy, inverse);
    StoreRow(TimesRotation({fx_z, zero, hn::Neg(hn::Mul(fx_z, x))}, r), block->jacobian, lane);
    StoreRow(TimesRotation({zero, fy_z, hn::Neg(hn::Mul(fy_z, y))}, r), block->jacobian + 3, lane);
  }
}

void AngularResiduals(const RayBlock& rays, ResidualBlock* block) {
  const Tag d;
  for (size_t lane = 0; lane < kBundleLanes; lane += hn::Lanes(d)) {
    const Vec3 x = Load3(block->x, lane), origin = Load3(rays.origin, lane);
    const Vec3 direction = Load3(rays.direction, lane);
    const Vec3 t0 = Load3(rays.tangents, lane), t1 = Load3(rays.tangents + 3, lane);
    const Vec3 delta = {hn::Sub(x.x, origin.x), hn::Sub(x.y, origin.y), hn::Sub(x.z, origin.z)};
    const Vec depth = dot(direction, delta);
    const Vec inverse = hn::Div(hn::Set(d, 1.0), depth);
    const Vec r0 = hn::Mul(dot(t0, delta), inverse), r1 = hn::Mul(dot(t1, delta), inverse);
    StoreResidual(hn::Gt(depth, hn::Zero(d)), r0, r1, block, lane);
    const auto row = [&](const Vec3& t, Vec r) HWY_ATTR {
      return Vec3{hn::Mul(hn::Sub(t.x, hn::Mul(r, direction.x)), inverse),
                  hn::Mul(hn::Sub(t.y, hn::Mul(r, direction.y)), inverse),
                  hn::Mul(hn::Sub(t.z, hn::Mul(r, direction.z)), inverse)};
    };
    StoreRow(row(t0, r0), block->jacobian, lane);
    StoreRow(row(t1, r1), block->jacobian + 3, lane);
  }
}

// With p = -(x, y) / z, s = |p|^2, g = 1 + k1 s + k2 s^2 and h = 2 k1 + 4 k2 s (the derivative of g by p is h
// p): the pixel is f g p, and its derivative by p is f (g I + h p p^T).
void LensResiduals(const BalLens& lens, const double* u, const double* v, ObservationBlock<9>* block) {
  const Tag d;
  const Vec f = hn::Set(d, lens.f), k1 = hn::Set(d, lens.k1), k2 = hn::Set(d, lens.k2);
  for (size_t lane = 0; lane < kBundleLanes; lane += hn::Lanes(d)) {
    const Vec3 x = Load3(block->x, lane);
    const Vec inverse = hn::Div(hn::Set(d, -1.0), x.z);
    const Vec px = hn::Mul(x.x, inverse), py = hn::Mul(x.y, inverse);
    const Vec s = dot(px, px, py, py);
    const Vec g = hn::Add(hn::Set(d, 1.0), hn::Mul(s, hn::Add(k1, hn::Mul(k2, s))));
    const Vec h = hn::Add(hn::Add(k1, k1), hn::Mul(hn::Set(d, 4.0), hn::Mul(k2, s)));
    const Vec fg = hn::Mul(f, g), fh = hn::Mul(f, h);
    const Vec r0 = hn::Sub(hn::Mul(fg, px), hn::LoadU(d, u + lane));
    const Vec r1 = hn::Sub(hn::Mul(fg, py), hn::LoadU(d, v + lane));
    StoreResidual(hn::Lt(x.z, hn::Zero(d)), r0, r1, block, lane);
    const auto row = [&](Vec by_px, Vec by_py) HWY_ATTR {
      const Vec by_z = dot(by_px, px, by_py, py);
      return Vec3{hn::Mul(by_px, inverse), hn::Mul(by_py, inverse), hn::Mul(by_z, inverse)};
    };
    const Vec mixed = hn::Mul(fh, hn::Mul(px, py));
    StoreRow(row(hn::Add(fg, hn::Mul(fh, hn::Mul(px, px))), mixed), block->jacobian, lane);
    StoreRow(row(mixed, hn::Add(fg, hn::Mul(fh, hn::Mul(py, py)))), block->jacobian + 3, lane);
    const Vec fs = hn::Mul(f, s), fss = hn::Mul(fs, s);
    StoreRow({hn::Mul(g, px), hn::Mul(fs, px), hn::Mul(fss, px)}, block->lens, lane);
    StoreRow({hn::Mul(g, py), hn::Mul(fs, py), hn::Mul(fss, py)}, block->lens + 3, lane);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace raysfm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace raysfm {

HWY_EXPORT(PinholeResiduals);
HWY_EXPORT(AngularResiduals);
HWY_EXPORT(LensResiduals);

void pinhole_residuals(const PinholeInRig& camera, const double* u, const double* v, ResidualBlock* block) {
  HWY_DYNAMIC_DISPATCH(PinholeResiduals)(camera, u, v, block);
}
void angular_residuals(const RayBlock& rays, ResidualBlock* block) {
  HWY_DYNAMIC_DISPATCH(AngularResiduals)(rays, block);
}
void lens_residuals(const BalLens& lens, const double* u, const double* v, ObservationBlock<9>* block) {
  HWY_DYNAMIC_DISPATCH(LensResiduals)(lens, u, v, block);
}

}  // namespace raysfm
#endif  // HWY_ONCE
