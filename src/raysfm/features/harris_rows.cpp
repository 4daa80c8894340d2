#include "raysfm/features/harris_rows.h"

#include <algorithm>
#include <bit>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "raysfm/features/harris_rows.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace raysfm {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

const hn::ScalableTag<float> kFloats;

#if HWY_TARGET != HWY_SCALAR
const hn::ScalableTag<int16_t> kShorts;
const hn::RepartitionToWide<decltype(kShorts)> kSums;

// gradients() for all columns; false where the row is shorter than a vector.
bool gradients_by_vectors(const uint8_t* above, const uint8_t* row, const uint8_t* below, int width,
                          int16_t* gx_row, int16_t* gy_row) {
  const hn::Rebind<uint8_t, decltype(kShorts)> bytes;
  const int lanes = static_cast<int>(hn::Lanes(kShorts));
  if (width - 2 < lanes) return false;
  const auto load = [&](const uint8_t* p) HWY_ATTR { return hn::PromoteTo(kShorts, hn::LoadU(bytes, p)); };
  // All but the first vector are aligned where they are written, the last unless it overlaps the one before.
  for (int step = 1; step < width - 1; step = (step + lanes) / lanes * lanes) {
    const int x = std::min(step, width - 1 - lanes);
    const auto above_left = load(above + x - 1), above_right = load(above + x + 1);
    const auto below_left = load(below + x - 1), below_right = load(below + x + 1);
    const auto across = hn::Sub(load(row + x + 1), load(row + x - 1));
    const auto down = hn::Sub(load(below + x), load(above + x));
    const auto diagonal = hn::Sub(below_right, above_left);  // shared by both gradients
    const auto antidiagonal = hn::Sub(above_right, below_left);
    hn::StoreU(hn::Add(hn::Add(diagonal, antidiagonal), hn::Add(across, across)), kShorts, gx_row + x);
    hn::StoreU(hn::Add(hn::Sub(diagonal, antidiagonal), hn::Add(down, down)), kShorts, gy_row + x);
  }
  return true;
}
#endif

void gradients(const uint8_t* above, const uint8_t* row, const uint8_t* below, int width, int16_t* gx,
               int16_t* gy) {
#if HWY_TARGET != HWY_SCALAR
  if (gradients_by_vectors(above, row, below, width, gx, gy)) return;
#endif
  for (int x = 1; x < width - 1; ++x) {
    const int across = row[x + 1] - row[x - 1], down = below[x] - above[x];
    gx[x] = static_cast<int16_t>(above[x + 1] - above[x - 1] + 2 * across + below[x + 1] - below[x - 1]);
    gy[x] = static_cast<int16_t>(below[x - 1] - above[x - 1] + 2 * down + below[x + 1] - above[x + 1]);
  }
}

// a + 4 b + 6 c + 4 d + e
template <class V>
HWY_INLINE V binomial(V a, V b, V c, V d, V e) {
  const auto four = hn::Set(kFloats, 4.0f), six = hn::Set(kFloats, 6.0f);
  return hn::Add(hn::Add(hn::Add(a, e), hn::Mul(four, hn::Add(b, d))), hn::Mul(six, c));
}

#if HWY_TARGET != HWY_SCALAR
// Columns x, x + 2, x + 4, ... of the sums: a column of the filter and the next one are two neighbours in a
// vector of gradients, whose products are added as they are widened.
HWY_INLINE void smooth_every_second(const int16_t* gx, const int16_t* gy, float* out) {
  const auto zero = hn::Zero(kSums);
  auto sum_xx = zero, sum_xy = zero, sum_yy = zero, odd_xx = zero, odd_xy = zero, odd_yy = zero;
  const auto add = [&](int column, int16_t weight, int16_t weight_of_next) HWY_ATTR {
    const auto weights = hn::OddEven(hn::Set(kShorts, weight_of_next), hn::Set(kShorts, weight));
    const auto x = hn::LoadU(kShorts, gx + column), y = hn::LoadU(kShorts, gy + column);
    const auto weighted_x = hn::Mul(x, weights), weighted_y = hn::Mul(y, weights);
    sum_xx = hn::ReorderWidenMulAccumulate(kSums, x, weighted_x, sum_xx, odd_xx);
    sum_xy = hn::ReorderWidenMulAccumulate(kSums, y, weighted_x, sum_xy, odd_xy);
    sum_yy = hn::ReorderWidenMulAccumulate(kSums, y, weighted_y, sum_yy, odd_yy);
  };
  add(-2, 1, 4), add(0, 6, 4), add(2, 1, 0);
  const auto store = [](auto sum, auto odd, float* to) HWY_ATTR {
    hn::Store(hn::ConvertTo(kFloats, hn::RearrangeToOddPlusEven(sum, odd)), kFloats, to);
  };
  store(sum_xx, odd_xx, out);
  store(sum_xy, odd_xy, out + kPartOfRow);
  store(sum_yy, odd_yy, out + 2 * kPartOfRow);
}
#endif

// Of as many columns as a vector of gradients has, the even ones come before the odd ones.
void smooth_products(const int16_t* gx, const int16_t* gy, int width, float* out) {
#if HWY_TARGET == HWY_SCALAR
  constexpr int kWeights[] = {1, 4, 6, 4, 1};
  for (int x = 0; x < width; ++x) {
    int sum_xx = 0, sum_xy = 0, sum_yy = 0;
    for (int k = 0; k < 5; ++k) {
      const int u = gx[x + k - 2], v = gy[x + k - 2];
      sum_xx += kWeights[k] * u * u, sum_xy += kWeights[k] * u * v, sum_yy += kWeights[k] * v * v;
    }
    out[x] = static_cast<float>(sum_xx), out[x + kPartOfRow] = static_cast<float>(sum_xy);
    out[x + 2 * kPartOfRow] = static_cast<float>(sum_yy);
  }
#else
  const int half = static_cast<int>(hn::Lanes(kFloats));
  for (int x = 0; x < width; x += 2 * half) {
    smooth_every_second(gx + x, gy + x, out + x);
    smooth_every_second(gx + x + 1, gy + x + 1, out + x + half);
  }
#endif
}

// Five rows; a copy, which no store can change, so that their addresses stay in registers.
struct Rows {
  explicit Rows(const float* const row[5]) : a(row[0]), b(row[1]), c(row[2]), d(row[3]), e(row[4]) {}
  const float *a, *b, *c, *d, *e;
};

// Two rows of responses at once, which share four of the rows that each of them looks at.
void harris_responses(const float* const rows[6], int width, float k, float* upper, float* lower) {
  using V = hn::Vec<decltype(kFloats)>;
  const int lanes = static_cast<int>(hn::Lanes(kFloats));
  const float *r0 = rows[0], *r1 = rows[1], *r2 = rows[2], *r3 = rows[3], *r4 = rows[4], *r5 = rows[5];
  const auto scale = hn::Set(kFloats, kSumsToMean * kSumsToMean);
  const auto weight = hn::Set(kFloats, k);
  const auto windows = [&](int x, V& above, V& below) HWY_ATTR {
    const auto load = [x](const float* row) HWY_ATTR { return hn::Load(kFloats, row + x); };
    const auto b = load(r1), c = load(r2), d = load(r3), e = load(r4);
    above = binomial(load(r0), b, c, d, e);
    below = binomial(b, c, d, e, load(r5));
  };
  const auto response = [&](V a, V b, V c) HWY_ATTR {
    const auto det = hn::Sub(hn::Mul(a, c), hn::Mul(b, b));
    const auto trace = hn::Add(a, c);
    return hn::Mul(scale, hn::Sub(det, hn::Mul(weight, hn::Mul(trace, trace))));
  };
  const auto responses = [&](int x, V& above, V& below) HWY_ATTR {
    V xx[2], xy[2], yy[2];
    windows(x, xx[0], xx[1]);
    windows(x + kPartOfRow, xy[0], xy[1]);
    windows(x + 2 * kPartOfRow, yy[0], yy[1]);
    above = response(xx[0], xy[0], yy[0]);
    below = response(xx[1], xy[1], yy[1]);
  };
#if HWY_TARGET == HWY_SCALAR
  for (int x = 0; x < width; x += lanes) {
    V above, below;
    responses(x, above, below);
    hn::Store(above, kFloats, upper + x);
    hn::Store(below, kFloats, lower + x);
  }
#else
  for (int x = 0; x < width; x += 2 * lanes) {
    V even_above, even_below, odd_above, odd_below;
    responses(x, even_above, even_below);
    responses(x + lanes, odd_above, odd_below);
    hn::StoreInterleaved2(even_above, odd_above, kFloats, upper + x);
    hn::StoreInterleaved2(even_below, odd_below, kFloats, lower + x);
  }
#endif
}

void max_along_row(const float* in, int width, float* out) {
  const int lanes = static_cast<int>(hn::Lanes(kFloats));
  for (int x = 0; x < width; x += lanes) {
    const auto load = [&](int dx) HWY_ATTR { return hn::LoadU(kFloats, in + x + dx); };
    const auto sides = hn::Max(hn::Max(load(-2), load(-1)), hn::Max(load(1), load(2)));
    hn::StoreU(hn::Max(sides, load(0)), kFloats, out + x);
  }
}

// Sets a bit for each maximum, kBytes for a vector of columns. No branch: where a corner may be is anybody's
// guess.
constexpr int kBytes = static_cast<int>((hn::MaxLanes(kFloats) + 7) / 8);
void mark_maxima(const float* row, const float* const greatest[5], int begin, int end, float min_score,
                 uint8_t* marks) {
  const int lanes = static_cast<int>(hn::Lanes(kFloats));
  const auto least = hn::Set(kFloats, min_score);
  const Rows g(greatest);
  for (int x = begin; x < end; x += lanes, marks += kBytes) {
    const auto load = [x](const float* from) HWY_ATTR { return hn::LoadU(kFloats, from + x); };
    const auto centre = load(row);
    const auto earlier = hn::Max(hn::Max(load(g.a), load(g.b)), hn::Max(load(row - 1), load(row - 2)));
    const auto others = hn::Max(hn::Max(load(g.c), load(g.d)), hn::Max(load(g.e), least));
    hn::StoreMaskBits(kFloats, hn::And(hn::Gt(centre, earlier), hn::Ge(centre, others)), marks);
  }
}

int find_maxima(const float* row, const float* const greatest[5], int begin, int end, float min_score,
                int* columns) {
  constexpr int kWord = 8;  // bytes
  const int lanes = static_cast<int>(hn::Lanes(kFloats));
  const int first = begin / lanes * lanes, bytes = (end - first + lanes - 1) / lanes * kBytes;
  uint8_t marks[kMaxRowWidth + 2 * kRowMargin];
  mark_maxima(row, greatest, first, end, min_score, marks);
  std::fill_n(marks + bytes, kWord, uint8_t{0});
  int count = 0;
  for (int byte = 0; byte < bytes; byte += kWord) {
    uint64_t bits = 0;
    for (int i = 0; i < kWord; ++i) bits |= uint64_t{marks[byte + i]} << (8 * i);
    for (; bits != 0; bits &= bits - 1) {
      const int bit = 8 * byte + std::countr_zero(bits);
      const int column = first + bit / (8 * kBytes) * lanes + bit % (8 * kBytes);
      if (column >= begin && column < end) columns[count++] = column;
    }
  }
  return count;
}

}  // namespace HWY_NAMESPACE
}  // namespace raysfm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace raysfm {

HWY_EXPORT(gradients);
HWY_EXPORT(smooth_products);
HWY_EXPORT(harris_responses);
HWY_EXPORT(max_along_row);
HWY_EXPORT(find_maxima);

void gradients(const uint8_t* above, const uint8_t* row, const uint8_t* below, int width, int16_t* gx,
               int16_t* gy) {
  HWY_DYNAMIC_DISPATCH(gradients)(above, row, below, width, gx, gy);
}

void smooth_products(const int16_t* gx, const int16_t* gy, int width, float* out) {
  HWY_DYNAMIC_DISPATCH(smooth_products)(gx, gy, width, out);
}

void harris_responses(const float* const rows[6], int width, float k, float* upper, float* lower) {
  HWY_DYNAMIC_DISPATCH(harris_responses)(rows, width, k, upper, lower);
}

void max_along_row(const float* in, int width, float* out) {
  HWY_DYNAMIC_DISPATCH(max_along_row)(in, width, out);
}

int find_maxima(const float* row, const float* const greatest[5], int begin, int end, float min_score,
                int* columns) {
  return HWY_DYNAMIC_DISPATCH(find_maxima)(row, greatest, begin, end, min_score, columns);
}

}  // namespace raysfm
#endif  // HWY_ONCE
