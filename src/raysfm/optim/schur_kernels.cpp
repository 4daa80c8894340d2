#include "raysfm/optim/schur_kernels.h"

#include <cstddef>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "raysfm/optim/schur_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace raysfm {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using Tag = hn::CappedTag<double, kCrossRows>;
constexpr int kPointLanes = 8;

// Products and sums are never fused, and each number is summed in the order of the slots: every target gives
// the same bits.

// diagonal + damping * diagonal, where a diagonal of zero counts as one.
template <class V>
HWY_INLINE V Damped(V diagonal, double damping) {
  const Tag d;
  const V scale = hn::IfThenElse(hn::Eq(diagonal, hn::Zero(d)), hn::Set(d, 1.0), diagonal);
  return hn::Add(diagonal, hn::Mul(hn::Set(d, damping), scale));
}

template <class V>
HWY_INLINE V InverseRoot(V pivot) {
  return hn::Div(hn::Set(Tag(), 1.0), hn::Sqrt(pivot));
}

// From nine numbers of each of eight points, v and gp, to their factors, in place.
void FactorizeLanes(double (*lanes)[kPointLanes], double damping) {
  const Tag d;
  const auto floor = hn::Set(d, 1e-14);
  for (size_t lane = 0; lane < kPointLanes; lane += hn::Lanes(d)) {
    const auto load = [&](int k) HWY_ATTR { return hn::Load(d, lanes[k] + lane); };
    const auto d0 = Damped(load(0), damping), d1 = Damped(load(3), damping), d2 = Damped(load(5), damping);
    const auto i00 = InverseRoot(d0);
    const auto l10 = hn::Mul(load(1), i00), l20 = hn::Mul(load(2), i00);
    const auto i11 = InverseRoot(hn::Max(hn::Sub(d1, hn::Mul(l10, l10)), hn::Mul(floor, d1)));
    const auto l21 = hn::Mul(hn::Sub(load(4), hn::Mul(l20, l10)), i11);
    const auto rest = hn::Sub(hn::Sub(d2, hn::Mul(l20, l20)), hn::Mul(l21, l21));
    const auto i22 = InverseRoot(hn::Max(rest, hn::Mul(floor, d2)));
    const auto i10 = hn::Neg(hn::Mul(l10, hn::Mul(i00, i11)));
    const auto i20 = hn::Neg(hn::Mul(hn::Add(hn::Mul(l20, i00), hn::Mul(l21, i10)), i22));
    const auto i21 = hn::Neg(hn::Mul(l21, hn::Mul(i11, i22)));
    const auto g0 = load(6), g1 = load(7), g2 = load(8);
    const auto store = [&](int k, auto v) HWY_ATTR { hn::Store(v, d, lanes[k] + lane); };
    store(0, i00), store(1, i10), store(2, i11), store(3, i20), store(4, i21), store(5, i22);
    store(6, hn::Mul(i00, g0));
    store(7, hn::Add(hn::Mul(i10, g0), hn::Mul(i11, g1)));
    store(8, hn::Add(hn::Add(hn::Mul(i20, g0), hn::Mul(i21, g1)), hn::Mul(i22, g2)));
  }
}

void FactorizePoints(const PointBlock* points, int count, double damping, double* factors) {
  alignas(64) double lanes[kFactorSize][kPointLanes] = {};
  for (int begin = 0; begin < count; begin += kPointLanes) {
    const int used = count - begin < kPointLanes ? count - begin : kPointLanes;
    for (int k = 0; k < used; ++k) {
      const PointBlock& point = points[begin + k];
      for (int c = 0; c < 6; ++c) lanes[c][k] = point.v[c];
      for (int c = 0; c < 3; ++c) lanes[6 + c][k] = point.gradient[c];
    }
    FactorizeLanes(lanes, damping);
    for (int k = 0; k < kPointLanes; ++k) {
      for (int c = 0; c < kFactorSize; ++c) factors[size_t{kFactorSize} * (begin + k) + c] = lanes[c][k];
    }
  }
}

void ScaleSlots(int point_count, const int* point_begin, const int* pose_of_slot, const double* factors,
                const double* w, double* z, double* right) {
  const Tag d;
  for (int p = 0; p < point_count; ++p) {
    const double* f = factors + size_t{9} * p;
    for (int s = point_begin[p]; s < point_begin[p + 1]; ++s) {
      const double* from = w + size_t{kCrossSize} * s;
      double* to = z + size_t{kCrossSize} * s;
      double* sum = right + size_t{kCrossRows} * pose_of_slot[s];
      for (size_t r = 0; r < 6; r += hn::Lanes(d)) {
        const auto w0 = hn::Load(d, from + r), w1 = hn::Load(d, from + kCrossRows + r),
                   w2 = hn::Load(d, from + 2 * kCrossRows + r);
        const auto z0 = hn::Mul(w0, hn::Set(d, f[0]));
        const auto z1 = hn::Add(hn::Mul(w0, hn::Set(d, f[1])), hn::Mul(w1, hn::Set(d, f[2])));
        const auto z2 = hn::Add(hn::Add(hn::Mul(w0, hn::Set(d, f[3])), hn::Mul(w1, hn::Set(d, f[4]))),
                                hn::Mul(w2, hn::Set(d, f[5])));
        hn::Store(z0, d, to + r);
        hn::Store(z1, d, to + kCrossRows + r);
        hn::Store(z2, d, to + 2 * kCrossRows + r);
        const auto zy = hn::Add(hn::Add(hn::Mul(z0, hn::Set(d, f[6])), hn::Mul(z1, hn::Set(d, f[7]))),
                                hn::Mul(z2, hn::Set(d, f[8])));
        hn::Store(hn::Add(hn::Load(d, sum + r), zy), d, sum + r);
      }
    }
  }
}

// The rows [row, row + lanes) of all six columns of the sum, kept in registers.
template <class D>
HWY_INLINE void SumRows(D d, const double* z, const SlotPair* pairs, int count, size_t row,
                        double (*sum)[kCrossRows]) {
  auto c0 = hn::Zero(d), c1 = c0, c2 = c0, c3 = c0, c4 = c0, c5 = c0;
  for (int i = 0; i < count; ++i) {
    const double* a = z + size_t{kCrossSize} * pairs[i].row + row;
    const double* b = z + size_t{kCrossSize} * pairs[i].column;
    const auto a0 = hn::Load(d, a), a1 = hn::Load(d, a + kCrossRows), a2 = hn::Load(d, a + 2 * kCrossRows);
    const auto column = [&](int c) HWY_ATTR {
      return hn::Add(hn::Add(hn::Mul(a0, hn::Set(d, b[c])), hn::Mul(a1, hn::Set(d, b[kCrossRows + c]))),
                     hn::Mul(a2, hn::Set(d, b[2 * kCrossRows + c])));
    };
    c0 = hn::Add(c0, column(0));
    c1 = hn::Add(c1, column(1));
    c2 = hn::Add(c2, column(2));
    c3 = hn::Add(c3, column(3));
    c4 = hn::Add(c4, column(4));
    c5 = hn::Add(c5, column(5));
  }
  hn::Store(c0, d, sum[0] + row);
  hn::Store(c1, d, sum[1] + row);
  hn::Store(c2, d, sum[2] + row);
  hn::Store(c3, d, sum[3] + row);
  hn::Store(c4, d, sum[4] + row);
  hn::Store(c5, d, sum[5] + row);
}

void SubtractProducts(const double* z, const SlotPair* pairs, int count, double* target) {
  const Tag d;
  alignas(64) double sum[6][kCrossRows];
  for (size_t row = 0; row < 6; row += hn::Lanes(d)) SumRows(d, z, pairs, count, row, sum);
  for (int c = 0; c < 6; ++c) {
    for (int r = 0; r < 6; ++r) target[6 * c + r] -= sum[c][r];
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace raysfm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace raysfm {

HWY_EXPORT(FactorizePoints);
HWY_EXPORT(ScaleSlots);
HWY_EXPORT(SubtractProducts);

void factorize_points(const PointBlock* points, int count, double damping, double* factors) {
  HWY_DYNAMIC_DISPATCH(FactorizePoints)(points, count, damping, factors);
}

void scale_slots(int point_count, const int* point_begin, const int* pose_of_slot, const double* factors,
                 const double* w, double* z, double* right) {
  HWY_DYNAMIC_DISPATCH(ScaleSlots)(point_count, point_begin, pose_of_slot, factors, w, z, right);
}

void subtract_products(const double* z, const SlotPair* pairs, int count, double* target) {
  HWY_DYNAMIC_DISPATCH(SubtractProducts)(z, pairs, count, target);
}

}  // namespace raysfm
#endif  // HWY_ONCE
