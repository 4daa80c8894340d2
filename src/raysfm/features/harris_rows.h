#pragma once

#include <cstdint>

namespace raysfm {

// The inner loops of the Harris detector, one image row at a time, with run-time choice of the instruction
// set. All arithmetic is exact or in a fixed order without fused operations, so every instruction set gives
// the same bits. Rows have kRowMargin readable and writable elements before the first and behind the last
// column, and their first column is aligned to 64 bytes.
constexpr int kRowMargin = 64;
constexpr int kMaxRowWidth = 320;
constexpr int kPartOfRow = kMaxRowWidth + kRowMargin;

// Factor from the sums below to the mean of products of gradients: Sobel's filter sums to 8 per pixel of
// distance, in both factors of a product; the window sums to 256.
constexpr float kSumsToMean = 1.0f / (8 * 8 * 256);

// Sobel gradients of the row between `above` and `below`, for columns 1 to width - 2.
void gradients(const uint8_t* above, const uint8_t* row, const uint8_t* below, int width, int16_t* gx,
               int16_t* gy);

// Products of gradients, filtered along the row by the binomial [1 4 6 4 1]: whole numbers below 2^24. A row
// has xx, xy and yy one after the other, each kPartOfRow long, and its columns in an order that only
// harris_responses() knows.
void smooth_products(const int16_t* gx, const int16_t* gy, int width, float* out);

// The same filter across five rows, and from it det(M) - k trace(M)^2, times kSumsToMean^2: from the first
// five of these rows of smooth_products() and from the last five.
void harris_responses(const float* const rows[6], int width, float k, float* upper, float* lower);

// Greatest of the five values around each column.
void max_along_row(const float* in, int width, float* out);

// Columns in [begin, end) of a row of responses that are at least `min_score` and the greatest of the 5 x 5
// around them (of equal ones, the first in scan order). greatest[i] is max_along_row() of row i - 2 from this
// one. Returns how many were written to `columns`, which has room for end - begin.
int find_maxima(const float* row, const float* const greatest[5], int begin, int end, float min_score,
                int* columns);

}  // namespace raysfm
