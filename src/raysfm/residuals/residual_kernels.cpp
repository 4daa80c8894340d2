#include "raysfm/residuals/residual_kernels.h"

#include <cmath>

// Vectors without a size at compile time cannot be members of the small structs below.
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV)
#endif
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "raysfm/residuals/residual_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace raysfm {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using Tag = hn::CappedTag<double, kBlockLanes>;
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
HWY_INLINE Vec3 Load3(const double (*from)[kBlockLanes], size_t lane) {
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

HWY_INLINE void StoreRow(const Vec3& row, double (*to)[kBlockLanes], size_t lane) {
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

// What a lens does to n = (x, y) = (X / Z, Y / Z), and the derivative by n, which is symmetric.
struct Distorted {
  Vec x, y;
  Vec xx, xy, yy;
};

// `distort` takes x, y and |n|^2; its results count where |n|^2 < max_radius2.
template <class F>
HWY_INLINE void PerspectiveResiduals(const PinholeInRig& camera, double max_radius2, const double* u,
                                     const double* v, ResidualBlock* block, F distort) {
  const Tag d;
  const double* r = camera.rotation;
  const Vec fx = hn::Set(d, camera.fx), fy = hn::Set(d, camera.fy), limit = hn::Set(d, max_radius2);
  for (size_t lane = 0; lane < kBlockLanes; lane += hn::Lanes(d)) {
    const Vec3 rig = Load3(block->x, lane);
    const Vec px = hn::Add(dot(Set3(r), rig), hn::Set(d, camera.translation[0]));
    const Vec py = hn::Add(dot(Set3(r + 3), rig), hn::Set(d, camera.translation[1]));
    const Vec pz = hn::Add(dot(Set3(r + 6), rig), hn::Set(d, camera.translation[2]));
    const Vec inverse = hn::Div(hn::Set(d, 1.0), pz);
    const Vec x = hn::Mul(px, inverse), y = hn::Mul(py, inverse);
    const Vec squared = dot(x, x, y, y);
    const Mask valid = hn::And(hn::Gt(pz, hn::Zero(d)), hn::Lt(squared, limit));
    const Distorted n = distort(x, y, squared);
    const Vec r0 = hn::Sub(hn::Add(hn::Mul(fx, n.x), hn::Set(d, camera.cx)), hn::LoadU(d, u + lane));
    const Vec r1 = hn::Sub(hn::Add(hn::Mul(fy, n.y), hn::Set(d, camera.cy)), hn::LoadU(d, v + lane));
    StoreResidual(valid, r0, r1, block, lane);
    const auto row = [&](Vec scale, Vec by_x, Vec by_y) HWY_ATTR {
      const Vec ax = hn::Mul(scale, by_x), ay = hn::Mul(scale, by_y);
      return TimesRotation({ax, ay, hn::Neg(dot(ax, x, ay, y))}, r);
    };
    StoreRow(row(hn::Mul(fx, inverse), n.xx, n.xy), block->jacobian, lane);
    StoreRow(row(hn::Mul(fy, inverse), n.xy, n.yy), block->jacobian + 3, lane);
  }
}

void PinholeResiduals(const PinholeInRig& camera, const double* u, const double* v, ResidualBlock* block) {
  const Tag d;
  const Vec zero = hn::Zero(d), one = hn::Set(d, 1.0);
  PerspectiveResiduals(camera, Pinhole::kMaxRadius * Pinhole::kMaxRadius, u, v, block,
                       [&](Vec x, Vec y, Vec) HWY_ATTR {
                         return Distorted{x, y, one, zero, one};
                       });
}

// The formulas of models/radial_tangential.h.
void RadtanResiduals(const RadtanInRig& camera, const double* u, const double* v, ResidualBlock* block) {
  const Tag d;
  const Vec one = hn::Set(d, 1.0), two = hn::Set(d, 2.0);
  const Vec k1 = hn::Set(d, camera.k1), k2 = hn::Set(d, camera.k2), k3 = hn::Set(d, camera.k3);
  const Vec p1 = hn::Set(d, camera.p1), p2 = hn::Set(d, camera.p2);
  const auto distort = [&](Vec x, Vec y, Vec q) HWY_ATTR {
    const Vec k23 = hn::Add(k2, hn::Mul(q, k3));
    const Vec s = hn::Add(one, hn::Mul(q, hn::Add(k1, hn::Mul(q, k23))));
    // Twice the slope of s.
    const Vec k2_3k3 = hn::Add(hn::Add(k23, k23), hn::Mul(q, k3));
    const Vec slope = hn::Mul(two, hn::Add(k1, hn::Mul(q, k2_3k3)));
    const Vec diagonal = hn::Add(s, hn::Mul(two, dot(p2, x, p1, y)));
    const Vec sx = hn::Mul(slope, x), sy = hn::Mul(slope, y);
    const Vec p1_twice = hn::Add(p1, p1), p2_twice = hn::Add(p2, p2);
    const Vec xx = hn::Mul(x, hn::Add(sx, hn::Add(p2_twice, p2_twice)));
    const Vec yy = hn::Mul(y, hn::Add(sy, hn::Add(p1_twice, p1_twice)));
    return Distorted{hn::Add(hn::Mul(diagonal, x), hn::Mul(p2, q)),
                     hn::Add(hn::Mul(diagonal, y), hn::Mul(p1, q)), hn::Add(diagonal, xx),
                     hn::Add(hn::Mul(sx, y), dot(p1_twice, x, p2_twice, y)), hn::Add(diagonal, yy)};
  };
  PerspectiveResiduals(camera.pinhole, camera.max_radius2, u, v, block, distort);
}

void AngularResiduals(const RayBlock& rays, ResidualBlock* block) {
  const Tag d;
  for (size_t lane = 0; lane < kBlockLanes; lane += hn::Lanes(d)) {
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
  for (size_t lane = 0; lane < kBlockLanes; lane += hn::Lanes(d)) {
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
HWY_EXPORT(RadtanResiduals);
HWY_EXPORT(AngularResiduals);
HWY_EXPORT(LensResiduals);

void pinhole_residuals(const PinholeInRig& camera, const double* u, const double* v, ResidualBlock* block) {
  HWY_DYNAMIC_DISPATCH(PinholeResiduals)(camera, u, v, block);
}
void radtan_residuals(const RadtanInRig& camera, const double* u, const double* v, ResidualBlock* block) {
  HWY_DYNAMIC_DISPATCH(RadtanResiduals)(camera, u, v, block);
}
void set_ray(const ObservedRay& ray, size_t lane, RayBlock* block) {
  for (int c = 0; c < 3; ++c) block->origin[c][lane] = ray.origin[c];
  for (int c = 0; c < 3; ++c) block->direction[c][lane] = ray.direction[c];
  for (int c = 0; c < 6; ++c) block->tangents[c][lane] = ray.tangents(c / 3, c % 3);
}
void angular_residuals(const RayBlock& rays, ResidualBlock* block) {
  HWY_DYNAMIC_DISPATCH(AngularResiduals)(rays, block);
}
void lens_residuals(const BalLens& lens, const double* u, const double* v, ObservationBlock<9>* block) {
  HWY_DYNAMIC_DISPATCH(LensResiduals)(lens, u, v, block);
}

}  // namespace raysfm
#endif  // HWY_ONCE
