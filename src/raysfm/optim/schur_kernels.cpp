#include "raysfm/optim/schur_kernels.h"

#include <cstddef>

// Vectors without a size at compile time cannot stand in the arrays below.
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV)
#endif
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "raysfm/optim/schur_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace raysfm {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
constexpr int kMostLanes = 8;
using Tag = hn::CappedTag<double, kMostLanes>;
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

// The rows [row, row + lanes) of the three columns of Z = W L^-T.
template <class D, class T>
HWY_INLINE void ScaleColumns(D d, const double* f, const T w0, const T w1, const T w2, T& z0, T& z1, T& z2) {
  z0 = hn::Mul(w0, hn::Set(d, f[0]));
  z1 = hn::Add(hn::Mul(w0, hn::Set(d, f[1])), hn::Mul(w1, hn::Set(d, f[2])));
  z2 = hn::Add(hn::Add(hn::Mul(w0, hn::Set(d, f[3])), hn::Mul(w1, hn::Set(d, f[4]))),
               hn::Mul(w2, hn::Set(d, f[5])));
}

// Of other blocks it neither reads nor writes anything: other threads work on these.
template <int N>
void ScaleSlots(int begin, int end, const int* point_begin, const int* place_of_slot, const double* factors,
                double* cross) {
  constexpr size_t kRows = kCrossRows<N>;
  const Tag d;
  for (int p = begin; p < end; ++p) {
    const double* f = factors + size_t{kFactorSize} * p;
    for (int s = point_begin[p]; s < point_begin[p + 1]; ++s) {
      double* slot = cross + size_t{kCrossSize<N>} * place_of_slot[s];
      for (size_t r = 0; r < kRows; r += hn::Lanes(d)) {
        const auto rows = hn::FirstN(d, kRows - r);
        auto z0 = hn::Zero(d), z1 = z0, z2 = z0;
        ScaleColumns(d, f, hn::MaskedLoad(rows, d, slot + r), hn::MaskedLoad(rows, d, slot + kRows + r),
                     hn::MaskedLoad(rows, d, slot + 2 * kRows + r), z0, z1, z2);
        hn::BlendedStore(z0, rows, d, slot + r);
        hn::BlendedStore(z1, rows, d, slot + kRows + r);
        hn::BlendedStore(z2, rows, d, slot + 2 * kRows + r);
      }
      if (N == kRows) continue;
      double* last = slot + 3 * kRows;
      last[2] = last[0] * f[3] + last[1] * f[4] + last[2] * f[5];
      last[1] = last[0] * f[1] + last[1] * f[2];
      last[0] = last[0] * f[0];
    }
  }
}
void ScaleSlots6(int begin, int end, const int* point_begin, const int* place_of_slot, const double* factors,
                 double* cross) {
  ScaleSlots<6>(begin, end, point_begin, place_of_slot, factors, cross);
}
void ScaleSlots9(int begin, int end, const int* point_begin, const int* place_of_slot, const double* factors,
                 double* cross) {
  ScaleSlots<9>(begin, end, point_begin, place_of_slot, factors, cross);
}

template <int N>
void AddRightSide(const double* z, const double* factors, const int* points, int count, double* right) {
  constexpr size_t kRows = kCrossRows<N>;
  const Tag d;
  alignas(64) double sum[kMostLanes];
  double last = 0;
  for (size_t r = 0; r < kRows; r += hn::Lanes(d)) {
    auto part = hn::Zero(d);
    for (int k = 0; k < count; ++k) {
      const double* y = factors + size_t{kFactorSize} * points[k] + 6;
      const double* from = z + size_t{kCrossSize<N>} * k + r;
      part = hn::Add(part, hn::Add(hn::Add(hn::Mul(hn::LoadU(d, from), hn::Set(d, y[0])),
                                           hn::Mul(hn::LoadU(d, from + kRows), hn::Set(d, y[1]))),
                                   hn::Mul(hn::LoadU(d, from + 2 * kRows), hn::Set(d, y[2]))));
      if (N == kRows || r > 0) continue;
      const double* tail = from + 3 * kRows;
      last += tail[0] * y[0] + tail[1] * y[1] + tail[2] * y[2];
    }
    hn::Store(part, d, sum + r);
  }
  for (size_t r = 0; r < N; ++r) right[r] += r < kRows ? sum[r] : last;
}
void AddRightSide6(const double* z, const double* factors, const int* points, int count, double* right) {
  AddRightSide<6>(z, factors, points, count, right);
}
void AddRightSide9(const double* z, const double* factors, const int* points, int count, double* right) {
  AddRightSide<9>(z, factors, points, count, right);
}

// The rows [row, row + lanes) of columns [kFirst, kFirst + kCount) of the sum, kept in registers.
template <int N, int kFirst, int kCount>
HWY_INLINE void SumRows(const double* z, const PlacePair* pairs, int count, size_t row,
                        double (*sum)[kMostLanes]) {
  constexpr size_t kRows = kCrossRows<N>;
  const Tag d;
  hn::Vec<Tag> total[kCount];
  for (int c = 0; c < kCount; ++c) total[c] = hn::Zero(d);
  for (int i = 0; i < count; ++i) {
    const double* a = z + size_t{kCrossSize<N>} * pairs[i].row + row;
    const double* b = z + size_t{kCrossSize<N>} * pairs[i].column;
    const auto a0 = hn::LoadU(d, a), a1 = hn::LoadU(d, a + kRows), a2 = hn::LoadU(d, a + 2 * kRows);
    for (int c = 0; c < kCount; ++c) {
      const auto b0 = hn::Set(d, b[cross_place<N>(kFirst + c, 0)]),
                 b1 = hn::Set(d, b[cross_place<N>(kFirst + c, 1)]),
                 b2 = hn::Set(d, b[cross_place<N>(kFirst + c, 2)]);
      total[c] = hn::Add(total[c], hn::Add(hn::Add(hn::Mul(a0, b0), hn::Mul(a1, b1)), hn::Mul(a2, b2)));
    }
  }
  for (int c = 0; c < kCount; ++c) hn::Store(total[c], d, sum[kFirst + c] + row);
}

// The ninth row of the sum.
HWY_INLINE void SumNinthRow(const double* z, const PlacePair* pairs, int count, double* sum) {
  constexpr size_t kRows = kCrossRows<9>;
  const Tag d;
  alignas(64) double part[kRows];
  double last = 0;
  for (size_t column = 0; column < kRows; column += hn::Lanes(d)) {
    auto total = hn::Zero(d);
    for (int i = 0; i < count; ++i) {
      const double* a = z + size_t{kCrossSize<9>} * pairs[i].row + 3 * kRows;
      const double* b = z + size_t{kCrossSize<9>} * pairs[i].column;
      total = hn::Add(total, hn::Add(hn::Add(hn::Mul(hn::Load(d, b + column), hn::Set(d, a[0])),
                                             hn::Mul(hn::Load(d, b + kRows + column), hn::Set(d, a[1]))),
                                     hn::Mul(hn::Load(d, b + 2 * kRows + column), hn::Set(d, a[2]))));
      if (column > 0) continue;
      const double* tail = b + 3 * kRows;
      last += a[0] * tail[0] + a[1] * tail[1] + a[2] * tail[2];
    }
    hn::Store(total, d, part + column);
  }
  for (size_t c = 0; c < kRows; ++c) sum[c] = part[c];
  sum[kRows] = last;
}

template <int N>
void SubtractProducts(const double* z, const PlacePair* pairs, int count, double* target, size_t stride) {
  constexpr size_t kRows = kCrossRows<N>;
  alignas(64) double sum[N][kMostLanes];
  for (size_t row = 0; row < kRows; row += hn::Lanes(Tag())) SumRows<N, 0, N>(z, pairs, count, row, sum);
  for (size_t c = 0; c < N; ++c) {
    for (size_t r = 0; r < kRows; ++r) target[stride * c + r] -= sum[c][r];
  }
  if (N == kRows) return;
  double ninth[9];
  SumNinthRow(z, pairs, count, ninth);
  for (size_t c = 0; c < N; ++c) target[stride * c + kRows] -= ninth[c];
}
void SubtractProducts6(const double* z, const PlacePair* pairs, int count, double* target, size_t stride) {
  SubtractProducts<6>(z, pairs, count, target, stride);
}
void SubtractProducts9(const double* z, const PlacePair* pairs, int count, double* target, size_t stride) {
  SubtractProducts<9>(z, pairs, count, target, stride);
}

}  // namespace HWY_NAMESPACE
}  // namespace raysfm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace raysfm {

HWY_EXPORT(FactorizePoints);
HWY_EXPORT(ScaleSlots6);
HWY_EXPORT(ScaleSlots9);
HWY_EXPORT(AddRightSide6);
HWY_EXPORT(AddRightSide9);
HWY_EXPORT(SubtractProducts6);
HWY_EXPORT(SubtractProducts9);

void factorize_points(const PointBlock* points, int count, double damping, double* factors) {
  HWY_DYNAMIC_DISPATCH(FactorizePoints)(points, count, damping, factors);
}

template <>
void scale_slots<6>(int begin, int end, const int* point_begin, const int* place_of_slot,
                    const double* factors, double* cross) {
  HWY_DYNAMIC_DISPATCH(ScaleSlots6)(begin, end, point_begin, place_of_slot, factors, cross);
}
template <>
void scale_slots<9>(int begin, int end, const int* point_begin, const int* place_of_slot,
                    const double* factors, double* cross) {
  HWY_DYNAMIC_DISPATCH(ScaleSlots9)(begin, end, point_begin, place_of_slot, factors, cross);
}

template <>
void add_right_side<6>(const double* z, const double* factors, const int* points, int count, double* right) {
  HWY_DYNAMIC_DISPATCH(AddRightSide6)(z, factors, points, count, right);
}
template <>
void add_right_side<9>(const double* z, const double* factors, const int* points, int count, double* right) {
  HWY_DYNAMIC_DISPATCH(AddRightSide9)(z, factors, points, count, right);
}

template <>
void subtract_products<6>(const double* z, const PlacePair* pairs, int count, double* target, size_t stride) {
  HWY_DYNAMIC_DISPATCH(SubtractProducts6)(z, pairs, count, target, stride);
}
template <>
void subtract_products<9>(const double* z, const PlacePair* pairs, int count, double* target, size_t stride) {
  HWY_DYNAMIC_DISPATCH(SubtractProducts9)(z, pairs, count, target, stride);
}

}  // namespace raysfm
#endif  // HWY_ONCE
