#pragma once

#include <cstddef>

namespace raysfm {

// Dense kernels of the block Cholesky factor. Matrices are stored by columns with a stride; every sum runs
// over its terms in ascending order whatever the instruction set, so that every one gives the same bits. Up
// to kKernelSlack numbers beyond the last row of a column may be read (not written).
inline constexpr int kKernelSlack = 32;

// C (rows x columns) -= A (rows x depth) B^T (columns x depth).
void subtract_product(int rows, int columns, int depth, const double* a, size_t a_stride, const double* b,
                      size_t b_stride, double* c, size_t c_stride);

// A (size x size, lower triangle) becomes its Cholesky factor. False when it is not positive definite or not
// finite. The upper triangle is left unspecified.
bool factorize_dense(int size, double* a, size_t stride);

// B (rows x size) becomes B L^-T.
void divide_by_transposed(int rows, int size, const double* l, size_t l_stride, double* b, size_t b_stride);

// y (rows) -= A (rows x columns) x.
void subtract_product_with_vector(int rows, int columns, const double* a, size_t stride, const double* x,
                                  double* y);

// y (columns) -= A^T x (rows).
void subtract_transposed_product_with_vector(int rows, int columns, const double* a, size_t stride,
                                             const double* x, double* y);

}  // namespace raysfm
