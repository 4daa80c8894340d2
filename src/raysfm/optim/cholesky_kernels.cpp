#include "raysfm/optim/cholesky_kernels.h"

#include <cmath>

// Vectors without a size at compile time cannot stand in the arrays below.
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV)
#endif
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "raysfm/optim/cholesky_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace raysfm {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using Tag = hn::CappedTag<double, 8>;
using V = hn::Vec<Tag>;

// Rows of a tile are kVectors vectors, columns kColumns: as many sums as fit into the registers.
#if HWY_TARGET <= HWY_AVX3
constexpr int kVectors = 3, kColumns = 8;
#else
constexpr int kVectors = 2, kColumns = 4;
#endif

// The first `rows` rows of C (kN columns) -= A B^T, for up to kM vectors of rows.
template <int kM, int kN>
HWY_INLINE void SubtractTile(int rows, int depth, const double* HWY_RESTRICT a, size_t a_stride,
                             const double* HWY_RESTRICT b, size_t b_stride, double* HWY_RESTRICT c,
                             size_t c_stride) {
  const Tag d;
  const size_t lanes = hn::Lanes(d);
  V sum[kM][kN];
  for (int m = 0; m < kM; ++m) {
    for (int n = 0; n < kN; ++n) sum[m][n] = hn::Zero(d);
  }
  for (int k = 0; k < depth; ++k) {
    V column[kM];
    for (int m = 0; m < kM; ++m) column[m] = hn::LoadU(d, a + k * a_stride + m * lanes);
    for (int n = 0; n < kN; ++n) {
      const V factor = hn::Set(d, b[k * b_stride + n]);
      for (int m = 0; m < kM; ++m) sum[m][n] = hn::Add(sum[m][n], hn::Mul(column[m], factor));
    }
  }
  for (int n = 0; n < kN; ++n) {
    for (int m = 0; m < kM; ++m) {
      double* to = c + n * c_stride + m * lanes;
      const int left = rows - static_cast<int>(m * lanes);
      if (left >= static_cast<int>(lanes)) {
        hn::StoreU(hn::Sub(hn::LoadU(d, to), sum[m][n]), d, to);
      } else {
        HWY_ALIGN double part[8];
        hn::Store(sum[m][n], d, part);
        for (int r = 0; r < left; ++r) to[r] -= part[r];
      }
    }
  }
}

template <int kM>
HWY_INLINE void SubtractRows(int rows, int columns, int depth, const double* a, size_t a_stride,
                             const double* b, size_t b_stride, double* c, size_t c_stride) {
  int n = 0;
  for (; n + kColumns <= columns; n += kColumns) {
    SubtractTile<kM, kColumns>(rows, depth, a, a_stride, b + n, b_stride, c + n * c_stride, c_stride);
  }
  for (; n + 2 <= columns; n += 2) {
    SubtractTile<kM, 2>(rows, depth, a, a_stride, b + n, b_stride, c + n * c_stride, c_stride);
  }
  for (; n < columns; ++n) {
    SubtractTile<kM, 1>(rows, depth, a, a_stride, b + n, b_stride, c + n * c_stride, c_stride);
  }
}

void SubtractProduct(int rows, int columns, int depth, const double* a, size_t a_stride, const double* b,
                     size_t b_stride, double* c, size_t c_stride) {
  const int lanes = static_cast<int>(hn::Lanes(Tag()));
  int r = 0;
  for (; r + (kVectors - 1) * lanes < rows; r += kVectors * lanes) {
    SubtractRows<kVectors>(rows - r, columns, depth, a + r, a_stride, b, b_stride, c + r, c_stride);
  }
  for (; r < rows; r += lanes) {
    SubtractRows<1>(rows - r, columns, depth, a + r, a_stride, b, b_stride, c + r, c_stride);
  }
}

// Columns [begin, end) of B, which are free of the columns before, become those of B L^-T.
void DivideColumns(int rows, int begin, int end, const double* l, size_t l_stride, double* b,
                   size_t b_stride) {
  const Tag d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  for (int c = begin; c < end; ++c) {
    double* column = b + c * b_stride;
    const double inverse = 1.0 / l[c * l_stride + c];
    int r = 0;
    for (; r + lanes <= rows; r += lanes) {
      V x = hn::LoadU(d, column + r);
      for (int k = begin; k < c; ++k) {
        x = hn::Sub(x, hn::Mul(hn::LoadU(d, b + k * b_stride + r), hn::Set(d, l[k * l_stride + c])));
      }
      hn::StoreU(hn::Mul(x, hn::Set(d, inverse)), d, column + r);
    }
    for (; r < rows; ++r) {
      double x = column[r];
      for (int k = begin; k < c; ++k) x -= b[k * b_stride + r] * l[k * l_stride + c];
      column[r] = x * inverse;
    }
  }
}

void SubtractProductWithVector(int rows, int columns, const double* a, size_t stride, const double* x,
                               double* y) {
  const Tag d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  int r = 0;
  for (; r + lanes <= rows; r += lanes) {
    V sum = hn::Zero(d);
    for (int c = 0; c < columns; ++c) {
      sum = hn::Add(sum, hn::Mul(hn::LoadU(d, a + c * stride + r), hn::Set(d, x[c])));
    }
    hn::StoreU(hn::Sub(hn::LoadU(d, y + r), sum), d, y + r);
  }
  for (; r < rows; ++r) {
    double sum = 0;
    for (int c = 0; c < columns; ++c) sum += a[c * stride + r] * x[c];
    y[r] -= sum;
  }
}

// Sums in eight lanes, whatever the width of the vectors.
void SubtractTransposedProductWithVector(int rows, int columns, const double* a, size_t stride,
                                         const double* x, double* y) {
  const Tag d;
  constexpr int kLanes = 8;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const int whole = rows / kLanes * kLanes;
  for (int c = 0; c < columns; ++c) {
    const double* column = a + c * stride;
    HWY_ALIGN double parts[kLanes];
    for (int lane = 0; lane < kLanes; lane += lanes) {
      V sum = hn::Zero(d);
      for (int r = lane; r < whole; r += kLanes) {
        sum = hn::Add(sum, hn::Mul(hn::LoadU(d, column + r), hn::LoadU(d, x + r)));
      }
      hn::Store(sum, d, parts + lane);
    }
    double sum = parts[0];
    for (int k = 1; k < kLanes; ++k) sum += parts[k];
    for (int r = whole; r < rows; ++r) sum += column[r] * x[r];
    y[c] -= sum;
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace raysfm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace raysfm {
namespace {

HWY_EXPORT(SubtractProduct);
HWY_EXPORT(DivideColumns);
HWY_EXPORT(SubtractProductWithVector);
HWY_EXPORT(SubtractTransposedProductWithVector);

constexpr int kStep = 8;  // columns that are worked on one by one, before all others are updated with them

// a (size x size, lower triangle) becomes its Cholesky factor.
bool factorize_small(int size, double* a, size_t stride) {
  for (int c = 0; c < size; ++c) {
    const double pivot = a[c * stride + c];
    if (!(pivot > 0) || !std::isfinite(pivot)) return false;
    const double root = std::sqrt(pivot);
    const double inverse = 1.0 / root;
    a[c * stride + c] = root;
    for (int r = c + 1; r < size; ++r) a[c * stride + r] *= inverse;
    for (int k = c + 1; k < size; ++k) {
      const double factor = a[c * stride + k];
      for (int r = k; r < size; ++r) a[k * stride + r] -= factor * a[c * stride + r];
    }
  }
  return true;
}

}  // namespace

void subtract_product(int rows, int columns, int depth, const double* a, size_t a_stride, const double* b,
                      size_t b_stride, double* c, size_t c_stride) {
  HWY_DYNAMIC_DISPATCH(SubtractProduct)
  (rows, columns, depth, a, a_stride, b, b_stride, c, c_stride);
}

bool factorize_dense(int size, double* a, size_t stride) {
  for (int begin = 0; begin < size; begin += kStep) {
    const int columns = size - begin < kStep ? size - begin : kStep, end = begin + columns;
    double* diagonal = a + begin * stride + begin;
    subtract_product(size - begin, columns, begin, a + begin, stride, a + begin, stride, diagonal, stride);
    if (!factorize_small(columns, diagonal, stride)) return false;
    HWY_DYNAMIC_DISPATCH(DivideColumns)
    (size - end, 0, columns, diagonal, stride, diagonal + columns, stride);
  }
  return true;
}

void divide_by_transposed(int rows, int size, const double* l, size_t l_stride, double* b, size_t b_stride) {
  for (int begin = 0; begin < size; begin += kStep) {
    const int columns = size - begin < kStep ? size - begin : kStep;
    subtract_product(rows, columns, begin, b, b_stride, l + begin, l_stride, b + begin * b_stride, b_stride);
    HWY_DYNAMIC_DISPATCH(DivideColumns)(rows, begin, begin + columns, l, l_stride, b, b_stride);
  }
}

void subtract_product_with_vector(int rows, int columns, const double* a, size_t stride, const double* x,
                                  double* y) {
  HWY_DYNAMIC_DISPATCH(SubtractProductWithVector)(rows, columns, a, stride, x, y);
}

void subtract_transposed_product_with_vector(int rows, int columns, const double* a, size_t stride,
                                             const double* x, double* y) {
  HWY_DYNAMIC_DISPATCH(SubtractTransposedProductWithVector)(rows, columns, a, stride, x, y);
}

}  // namespace raysfm
#endif  // HWY_ONCE
