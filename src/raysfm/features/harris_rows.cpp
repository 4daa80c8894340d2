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
template <class V>
HWY_INLINE void store_products(V gx16, V gy16, float* xx, float* xy, float* yy) {
  const hn::Rebind<int32_t, decltype(kFloats)> ints;
  const auto gx = hn::ConvertTo(kFloats, hn::PromoteTo(ints, gx16));
  const auto gy = hn::ConvertTo(kFloats, hn::PromoteTo(ints, gy16));
  hn::StoreU(hn::Mul(gx, gx), kFloats, xx);
  hn::StoreU(hn::Mul(gx, gy), kFloats, xy);
  hn::StoreU(hn::Mul(gy, gy), kFloats, yy);
}

// gradient_products() for all columns; false where the row is shorter than a vector.
bool gradient_products_by_vectors(const uint8_t* above, const uint8_t* row, const uint8_t* below, int width,
                                  float* xx, float* xy, float* yy) {
  const hn::ScalableTag<int16_t> shorts;
  const hn::Half<decltype(shorts)> half;
  const hn::Rebind<uint8_t, decltype(shorts)> bytes;
  const int lanes = static_cast<int>(hn::Lanes(shorts));
  if (width - 2 < lanes) return false;
  const auto load = [&](const uint8_t* p) HWY_ATTR { return hn::PromoteTo(shorts, hn::LoadU(bytes, p)); };
  // All but the first vector are aligned where they are written, the last unless it overlaps the one before.
  for (int step = 1; step < width - 1; step = (step + lanes) / lanes * lanes) {
    const int x = std::min(step, width - 1 - lanes);
    const auto above_left = load(above + x - 1), above_right = load(above + x + 1);
    const auto below_left = load(below + x - 1), below_right = load(below + x + 1);
    const auto across = hn::Sub(load(row + x + 1), load(row + x - 1));
    const auto down = hn::Sub(load(below + x), load(above + x));
    const auto diagonal = hn::Sub(below_right, above_left);  // shared by both gradients
    const auto antidiagonal = hn::Sub(above_right, below_left);
    const auto gx = hn::Add(hn::Add(diagonal, antidiagonal), hn::Add(across, across));
    const auto gy = hn::Add(hn::Sub(diagonal, antidiagonal), hn::Add(down, down));
    store_products(hn::LowerHalf(half, gx), hn::LowerHalf(half, gy), xx + x, xy + x, yy + x);
    const int high = x + lanes / 2;
    store_products(hn::UpperHalf(half, gx), hn::UpperHalf(half, gy), xx + high, xy + high, yy + high);
  }
  return true;
}
#endif

void gradient_products(const uint8_t* above, const uint8_t* row, const uint8_t* below, int width, float* xx,
                       float* xy, float* yy) {
#if HWY_TARGET != HWY_SCALAR
  if (gradient_products_by_vectors(above, row, below, width, xx, xy, yy)) return;
#endif
  for (int x = 1; x < width - 1; ++x) {
    const int gx = above[x + 1] - above[x - 1] + 2 * (row[x + 1] - row[x - 1]) + below[x + 1] - below[x - 1];
    const int gy = below[x - 1] - above[x - 1] + 2 * (below[x] - above[x]) + below[x + 1] - above[x + 1];
    xx[x] = static_cast<float>(gx * gx);
    xy[x] = static_cast<float>(gx * gy);
    yy[x] = static_cast<float>(gy * gy);
  }
}

// a + 4 b + 6 c + 4 d + e
template <class V>
HWY_INLINE V binomial(V a, V b, V c, V d, V e) {
  const auto four = hn::Set(kFloats, 4.0f), six = hn::Set(kFloats, 6.0f);
  return hn::Add(hn::Add(hn::Add(a, e), hn::Mul(four, hn::Add(b, d))), hn::Mul(six, c));
}

void smooth_along_row(const float* in, int width, float* out) {
  const int lanes = static_cast<int>(hn::Lanes(kFloats));
  for (int x = 0; x < width; x += lanes) {
    const auto load = [&](int dx) HWY_ATTR { return hn::LoadU(kFloats, in + x + dx); };
    hn::StoreU(binomial(load(-2), load(-1), load(0), load(1), load(2)), kFloats, out + x);
  }
}

// Five rows; a copy, which no store can change, so that their addresses stay in registers.
struct Rows {
  explicit Rows(const float* const row[5]) : a(row[0]), b(row[1]), c(row[2]), d(row[3]), e(row[4]) {}
  const float *a, *b, *c, *d, *e;
};

void harris_response(const float* const xx[5], const float* const xy[5], const float* const yy[5], int width,
                     float k, float* response) {
  const int lanes = static_cast<int>(hn::Lanes(kFloats));
  const Rows rows_xx(xx), rows_xy(xy), rows_yy(yy);
  const auto scale = hn::Set(kFloats, kSumsToMean * kSumsToMean);
  const auto weight = hn::Set(kFloats, k);
  for (int x = 0; x < width; x += lanes) {
    const auto window = [x](const Rows& r) HWY_ATTR {
      const auto load = [x](const float* row) HWY_ATTR { return hn::LoadU(kFloats, row + x); };
      return binomial(load(r.a), load(r.b), load(r.c), load(r.d), load(r.e));
    };
    const auto a = window(rows_xx), b = window(rows_xy), c = window(rows_yy);
    const auto det = hn::Sub(hn::Mul(a, c), hn::Mul(b, b));
    const auto trace = hn::Add(a, c);
    const auto sum = hn::Sub(det, hn::Mul(weight, hn::Mul(trace, trace)));
    hn::StoreU(hn::Mul(scale, sum), kFloats, response + x);
  }
}

void max_along_row(const float* in, int width, float* out) {
  const int lanes = static_cast<int>(hn::Lanes(kFloats));
  for (int x = 0; x < width; x += lanes) {
    const auto load = [&](int dx) HWY_ATTR { return hn::LoadU(kFloats, in + x + dx); };
    const auto sides = hn::Max(hn::Max(load(-2), load(-1)), hn::Max(load(1), load(2)));
    hn::StoreU(hn::Max(sides, load(0)), kFloats, out + x);
  }
}

int find_maxima(const float* row, const float* const greatest[5], int begin, int end, float min_score,
                int* columns) {
  const int lanes = static_cast<int>(hn::Lanes(kFloats));
  const auto least = hn::Set(kFloats, min_score);
  const Rows g(greatest);
  int count = 0;
  for (int x = begin / lanes * lanes; x < end; x += lanes) {
    const auto load = [x](const float* from) HWY_ATTR { return hn::LoadU(kFloats, from + x); };
    const auto centre = load(row);
    const auto after = hn::Max(hn::Max(load(g.c), least), hn::Max(load(g.d), load(g.e)));
    const auto is_max = hn::And(hn::Gt(centre, hn::Max(load(g.a), load(g.b))), hn::Ge(centre, after));
    if (hn::AllFalse(kFloats, is_max)) continue;
    uint8_t bytes[8] = {};
    hn::StoreMaskBits(kFloats, is_max, bytes);
    uint64_t bits = 0;
    for (int i = 0; i < 8; ++i) bits |= uint64_t{bytes[i]} << (8 * i);
    for (; bits != 0; bits &= bits - 1) {
      const int column = x + std::countr_zero(bits);
      const bool is_first = row[column] > row[column - 1] && row[column] > row[column - 2];
      if (column >= begin && column < end && is_first) columns[count++] = column;
    }
  }
  return count;
}

}  // namespace HWY_NAMESPACE
}  // namespace raysfm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace raysfm {

HWY_EXPORT(gradient_products);
HWY_EXPORT(smooth_along_row);
HWY_EXPORT(harris_response);
HWY_EXPORT(max_along_row);
HWY_EXPORT(find_maxima);

void gradient_products(const uint8_t* above, const uint8_t* row, const uint8_t* below, int width, float* xx,
                       float* xy, float* yy) {
  HWY_DYNAMIC_DISPATCH(gradient_products)(above, row, below, width, xx, xy, yy);
}

void smooth_along_row(const float* in, int width, float* out) {
  HWY_DYNAMIC_DISPATCH(smooth_along_row)(in, width, out);
}

void harris_response(const float* const xx[5], const float* const xy[5], const float* const yy[5], int width,
                     float k, float* response) {
  HWY_DYNAMIC_DISPATCH(harris_response)(xx, xy, yy, width, k, response);
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
