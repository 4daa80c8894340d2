#pragma once

#include <cstdint>

namespace raysfm {

// The inner loops of the Harris detector, one image row at a time, with run-time choice of the instruction
// set. All arithmetic is exact or in a fixed order without fused operations, so every instruction set gives
// the same bits. Float rows have kRowMargin readable and writable elements before the first and behind the
// last column.
constexpr int kRowMargin = 64;

// Factor from the sums below to the mean of products of gradients: Sobel's filter sums to 8 per pixel of
// distance, in both factors of a product; the window sums to 256.
constexpr float kSumsToMean = 1.0f / (8 * 8 * 256);

// Products of Sobel gradients of the row between `above` and `below`, for columns 1 to width - 2.
void gradient_products(const uint8_t* above, const uint8_t* row, const uint8_t* below, int width, float* xx,
                       float* xy, float* yy);

// Binomial filter [1 4 6 4 1] along a row.
void smooth_along_row(const float* in, int width, float* out);

// The same filter across five rows of each product, and from it det(M) - k trace(M)^2, times kSumsToMean^2.
void harris_response(const float* const xx[5], const float* const xy[5], const float* const yy[5], int width,
                     float k, float* response);

// Greatest of the five values around each column.
void max_along_row(const float* in, int width, float* out);

// Columns in [begin, end) of a row of responses that are at least `min_score` and the greatest of the 5 x 5
// around them (of equal ones, the first in scan order). greatest[i] is max_along_row() of row i - 2 from this
// one. Returns how many were written to `columns`, which has room for end - begin.
int find_maxima(const float* row, const float* const greatest[5], int begin, int end, float min_score,
                int* columns);

}  // namespace raysfm
