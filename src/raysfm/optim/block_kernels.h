#pragma once

// Small dense kernels on 6-row blocks stored by columns: element (r, c) is at [6 c + r].
namespace raysfm::block {

inline constexpr int kRows = 6;
inline constexpr int kSize = kRows * kRows;

// C (6x6) -= A (6xK) B^T (Kx6).
template <int K>
inline void subtract_product(const double* a, const double* b, double* c) {
  for (int col = 0; col < kRows; ++col) {
    for (int row = 0; row < kRows; ++row) {
      double sum = 0;
      for (int k = 0; k < K; ++k) sum += a[kRows * k + row] * b[kRows * k + col];
      c[kRows * col + row] -= sum;
    }
  }
}

// y (6) += s A (6xK) x (K).
template <int K>
inline void add_product(const double* a, const double* x, double s, double* y) {
  for (int k = 0; k < K; ++k) {
    for (int row = 0; row < kRows; ++row) y[row] += s * a[kRows * k + row] * x[k];
  }
}

// y (K) += s A^T (Kx6) x (6).
template <int K>
inline void add_transposed_product(const double* a, const double* x, double s, double* y) {
  for (int k = 0; k < K; ++k) {
    double sum = 0;
    for (int row = 0; row < kRows; ++row) sum += a[kRows * k + row] * x[row];
    y[k] += s * sum;
  }
}

}  // namespace raysfm::block
