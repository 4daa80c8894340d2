#include "raysfm/lenses/elimination_kernels.h"

#include <cstddef>

// Vectors without a size at compile time cannot stand in the arrays below.
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV)
#endif
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "raysfm/lenses/elimination_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace raysfm {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using Tag = hn::CappedTag<double, 4>;
using V = hn::Vec<Tag>;
constexpr int kMaxPadded = 12;

void ScaleSlots(int padded, int slots, const int* places, const double* inverse, const double* all_w,
                double* all_z) {
  const Tag d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const V i00 = hn::Set(d, inverse[0]), i10 = hn::Set(d, inverse[1]), i11 = hn::Set(d, inverse[2]),
          i20 = hn::Set(d, inverse[3]), i21 = hn::Set(d, inverse[4]), i22 = hn::Set(d, inverse[5]);
  for (int s = 0; s < slots; ++s) {
    const double* w = all_w + size_t{3} * padded * places[s];
    double* z = all_z + size_t{3} * padded * places[s];
    for (int r = 0; r < padded; r += lanes) {
      const V w0 = hn::LoadU(d, w + r), w1 = hn::LoadU(d, w + padded + r),
              w2 = hn::LoadU(d, w + 2 * padded + r);
      hn::StoreU(hn::Mul(w0, i00), d, z + r);
      hn::StoreU(hn::Add(hn::Mul(w0, i10), hn::Mul(w1, i11)), d, z + padded + r);
      hn::StoreU(hn::Add(hn::Add(hn::Mul(w0, i20), hn::Mul(w1, i21)), hn::Mul(w2, i22)), d,
                 z + 2 * padded + r);
    }
  }
}

void SubtractProducts(int padded, int count, const double* all_z, const int* points, const double* all_y,
                      double* right) {
  const Tag d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  for (int r = 0; r < padded; r += lanes) {
    V rest = hn::LoadU(d, right + r);
    const double* z = all_z + r;
    for (int s = 0; s < count; ++s, z += 3 * padded) {
      const double* y = all_y + size_t{3} * points[s];
      const V z0 = hn::LoadU(d, z), z1 = hn::LoadU(d, z + padded), z2 = hn::LoadU(d, z + 2 * padded);
      rest = hn::Sub(rest, hn::Add(hn::Add(hn::Mul(z0, hn::Set(d, y[0])), hn::Mul(z1, hn::Set(d, y[1]))),
                                   hn::Mul(z2, hn::Set(d, y[2]))));
    }
    hn::StoreU(rest, d, right + r);
  }
}

// Columns [column, column + kColumns) of the sum, kRows numbers each, kept in registers.
template <int kRows, int kColumns>
HWY_INLINE void SubtractColumns(const double* z, const EliminationPair* pairs, int count, int column,
                                double* target, int stride) {
  const Tag d;
  constexpr int kLanes = HWY_MIN(4, static_cast<int>(HWY_MAX_BYTES / sizeof(double)));
  constexpr int kVectors = kRows / kLanes;
  V sum[kColumns][kVectors];
  for (int c = 0; c < kColumns; ++c) {
    for (int v = 0; v < kVectors; ++v) sum[c][v] = hn::Zero(d);
  }
  for (int i = 0; i < count; ++i) {
    const double* a = z + pairs[i].row;
    const double* b = z + pairs[i].column + column;
    for (int k = 0; k < 3; ++k, a += kRows, b += kRows) {
      V rows[kVectors];
      for (int v = 0; v < kVectors; ++v) rows[v] = hn::LoadU(d, a + v * kLanes);
      for (int c = 0; c < kColumns; ++c) {
        const V factor = hn::Set(d, b[c]);
        for (int v = 0; v < kVectors; ++v) sum[c][v] = hn::Add(sum[c][v], hn::Mul(rows[v], factor));
      }
    }
  }
  for (int c = 0; c < kColumns; ++c) {
    double* to = target + static_cast<ptrdiff_t>(stride) * (column + c);
    for (int v = 0; v < kVectors; ++v) {
      hn::StoreU(hn::Sub(hn::LoadU(d, to + v * kLanes), sum[c][v]), d, to + v * kLanes);
    }
  }
}

template <int kRows>
HWY_INLINE void SubtractBlock(int columns, const double* z, const EliminationPair* pairs, int count,
                              double* target, int stride) {
  // As many sums as there are registers for.
  constexpr int kWidest = HWY_MAX_BYTES >= 32 && kRows == 8 ? 6 : 3;
  int c = 0;
  for (; c + kWidest <= columns; c += kWidest) {
    SubtractColumns<kRows, kWidest>(z, pairs, count, c, target, stride);
  }
  for (; c + 3 <= columns; c += 3) SubtractColumns<kRows, 3>(z, pairs, count, c, target, stride);
  for (; c < columns; ++c) SubtractColumns<kRows, 1>(z, pairs, count, c, target, stride);
}

void SubtractPairs(int padded, int columns, const double* z, const EliminationPair* pairs, int count,
                   double* target, int stride) {
  if (padded == 8) {
    SubtractBlock<8>(columns, z, pairs, count, target, stride);
  } else {
    SubtractBlock<12>(columns, z, pairs, count, target, stride);
  }
}

void AddTransposed(int padded, int slots, const int* first, const int* places, const double* z,
                   const double* numbers, double* sum) {
  const Tag d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  HWY_ALIGN double parts[3][kMaxPadded] = {};
  for (int r = 0; r < padded; r += lanes) {
    V total[3] = {hn::Zero(d), hn::Zero(d), hn::Zero(d)};
    for (int s = 0; s < slots; ++s) {
      const double* column = z + size_t{3} * padded * places[s] + r;
      const V c = hn::LoadU(d, numbers + first[s] + r);
      for (int k = 0; k < 3; ++k, column += padded) {
        total[k] = hn::Add(total[k], hn::Mul(hn::LoadU(d, column), c));
      }
    }
    for (int k = 0; k < 3; ++k) hn::StoreU(total[k], d, parts[k] + r);
  }
  for (int k = 0; k < 3; ++k) {
    for (int r = 0; r < padded; ++r) sum[k] += parts[k][r];
  }
}

void AddOuterProducts(const double* first_row, const double* second_row, double weight, int columns,
                      double* sum) {
  const Tag d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  for (int c = 0; c < columns; ++c, sum += kJacobianRow) {
    const V first = hn::Set(d, weight * first_row[c]), second = hn::Set(d, weight * second_row[c]);
    for (int r = c / lanes * lanes; r < kJacobianRow; r += lanes) {
      const V term =
          hn::Add(hn::Mul(hn::LoadU(d, first_row + r), first), hn::Mul(hn::LoadU(d, second_row + r), second));
      hn::StoreU(hn::Add(hn::LoadU(d, sum + r), term), d, sum + r);
    }
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace raysfm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace raysfm {

HWY_EXPORT(ScaleSlots);
HWY_EXPORT(SubtractProducts);
HWY_EXPORT(SubtractPairs);
HWY_EXPORT(AddTransposed);
HWY_EXPORT(AddOuterProducts);

void scale_point_slots(int padded, int slots, const int* places, const double* inverse, const double* w,
                       double* z) {
  HWY_DYNAMIC_DISPATCH(ScaleSlots)(padded, slots, places, inverse, w, z);
}

void subtract_products(int padded, int count, const double* z, const int* points, const double* y,
                       double* right) {
  HWY_DYNAMIC_DISPATCH(SubtractProducts)(padded, count, z, points, y, right);
}

void subtract_pairs(int padded, int columns, const double* z, const EliminationPair* pairs, int count,
                    double* target, int stride) {
  HWY_DYNAMIC_DISPATCH(SubtractPairs)(padded, columns, z, pairs, count, target, stride);
}

void add_transposed(int padded, int slots, const int* first, const int* places, const double* z,
                    const double* numbers, double* sum) {
  HWY_DYNAMIC_DISPATCH(AddTransposed)(padded, slots, first, places, z, numbers, sum);
}

void add_outer_products(const double* first_row, const double* second_row, double weight, int columns,
                        double* sum) {
  HWY_DYNAMIC_DISPATCH(AddOuterProducts)(first_row, second_row, weight, columns, sum);
}

}  // namespace raysfm
#endif  // HWY_ONCE
