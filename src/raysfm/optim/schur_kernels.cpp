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

// Products and sums are never fused, and each number is summed in the order of the slots: every target gives
// the same bits.

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

HWY_EXPORT(ScaleSlots);
HWY_EXPORT(SubtractProducts);

void scale_slots(int point_count, const int* point_begin, const int* pose_of_slot, const double* factors,
                 const double* w, double* z, double* right) {
  HWY_DYNAMIC_DISPATCH(ScaleSlots)(point_count, point_begin, pose_of_slot, factors, w, z, right);
}

void subtract_products(const double* z, const SlotPair* pairs, int count, double* target) {
  HWY_DYNAMIC_DISPATCH(SubtractProducts)(z, pairs, count, target);
}

}  // namespace raysfm
#endif  // HWY_ONCE
