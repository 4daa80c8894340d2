#include "raysfm/features/coarse_rotation.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <vector>

#include "raysfm/features/shift_search.h"
#include "raysfm/image/pyramid.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "raysfm/features/coarse_rotation.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef RAYSFM_FEATURES_COARSE_ROTATION_ONCE
#define RAYSFM_FEATURES_COARSE_ROTATION_ONCE
namespace raysfm::coarse {

constexpr int kColumns = 16;  // sums run over this many interleaved columns, whatever the vectors' length

// Places in the second image: p -> centre + R(angle) (p - centre) + shift, pixels of the level.
struct Motion {
  float x = 0, y = 0, angle = 0;
};

// Sums over the overlap. J is the gradient of the first image times the derivative of its motion (x, y,
// angle); r = gain * second + bias - first.
struct Sums {
  enum { kJxJx, kJxJy, kJxJa, kJyJy, kJyJa, kJaJa, kJxR, kJyR, kJaR, kN, kA, kB, kAA, kAB, kBB, kCount };
  float v[kCount];
};

}  // namespace raysfm::coarse
#endif

HWY_BEFORE_NAMESPACE();
namespace raysfm {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

const hn::CappedTag<float, coarse::kColumns> kFloats;
const hn::RebindToSigned<decltype(kFloats)> kInts;

// Bytes to floats, from any place.
HWY_INLINE auto load_bytes(const uint8_t* p) {
  const hn::Rebind<uint8_t, decltype(kFloats)> bytes;
  return hn::ConvertTo(kFloats, hn::PromoteTo(kInts, hn::LoadU(bytes, p)));
}

// Bilinear samples at places inside the image, left of its last column and above its last row.
template <class V>
HWY_INLINE V sample(const GrayView& image, V x, V y) {
  const auto byte = hn::Set(kInts, 0xff), stride = hn::Set(kInts, static_cast<int32_t>(image.stride));
  const auto* base = reinterpret_cast<const int32_t*>(image.data);
  const auto ix = hn::ConvertTo(kInts, x), iy = hn::ConvertTo(kInts, y);
  const auto wx = hn::Sub(x, hn::ConvertTo(kFloats, ix)), wy = hn::Sub(y, hn::ConvertTo(kFloats, iy));
  const auto at = hn::Add(hn::Mul(iy, stride), ix);
  const auto blend = [&](auto four) HWY_ATTR {
    const auto left = hn::ConvertTo(kFloats, hn::And(four, byte));
    const auto right = hn::ConvertTo(kFloats, hn::And(hn::ShiftRight<8>(four), byte));
    return hn::Add(left, hn::Mul(wx, hn::Sub(right, left)));
  };
  const auto top = blend(hn::GatherOffset(kInts, base, at));
  const auto bottom = blend(hn::GatherOffset(kInts, base, hn::Add(at, stride)));
  return hn::Add(top, hn::Mul(wy, hn::Sub(bottom, top)));
}

// Both images own 64 bytes behind their last row (Image), so that the last vector of a row may run over.
void sum_residuals(const GrayView& first, const GrayView& second, const coarse::Motion& motion, float gain,
                   float bias, coarse::Sums* sums) {
  using coarse::Sums;
  const int w = first.width, h = first.height;
  const float cx = 0.5f * static_cast<float>(w - 1), cy = 0.5f * static_cast<float>(h - 1);
  const float cosine = std::cos(motion.angle), sine = std::sin(motion.angle);
  const int lanes = static_cast<int>(hn::Lanes(kFloats));
  const auto set = [](float v) HWY_ATTR { return hn::Set(kFloats, v); };
  const auto one = set(1.0f), half = set(0.5f), zero = hn::Zero(kFloats);
  const auto last_x = set(static_cast<float>(w - 2)), last_y = set(static_cast<float>(h - 2));
  const auto last_column = set(static_cast<float>(w - 1));
  alignas(64) float columns[Sums::kCount][coarse::kColumns] = {};

  for (int part = 0; part < coarse::kColumns; part += lanes) {
    auto jxjx = zero, jxjy = zero, jxja = zero, jyjy = zero, jyja = zero, jaja = zero;
    auto jxr = zero, jyr = zero, jar = zero, n = zero, sa = zero, sb = zero, saa = zero, sab = zero,
         sbb = zero;
    for (int y = 1; y < h - 1; ++y) {
      const uint8_t* row = first.row(y);
      const float v = static_cast<float>(y) - cy;
      const auto x_of_row = set(cx + motion.x - sine * v), y_of_row = set(cy + motion.y + cosine * v);
      for (int x = 1 + part; x < w - 1; x += coarse::kColumns) {
        const auto column = hn::Add(set(static_cast<float>(x)), hn::ConvertTo(kFloats, hn::Iota(kInts, 0)));
        const auto u = hn::Sub(column, set(cx));
        const auto px = hn::Add(x_of_row, hn::Mul(set(cosine), u));
        const auto py = hn::Add(y_of_row, hn::Mul(set(sine), u));
        const auto qx = hn::Min(hn::Max(px, zero), last_x), qy = hn::Min(hn::Max(py, zero), last_y);
        const auto inside = hn::And(hn::And(hn::Eq(px, qx), hn::Eq(py, qy)), hn::Lt(column, last_column));
        const auto weight = hn::IfThenElseZero(inside, one);

        const auto b = hn::Mul(weight, sample(second, qx, qy));
        const auto a = hn::Mul(weight, load_bytes(row + x));

        const auto halves = hn::Mul(weight, half);
        const auto jx = hn::Mul(halves, hn::Sub(load_bytes(row + x + 1), load_bytes(row + x - 1)));
        const auto jy =
            hn::Mul(halves, hn::Sub(load_bytes(row + x + first.stride), load_bytes(row + x - first.stride)));
        const auto ja = hn::Sub(hn::Mul(jy, u), hn::Mul(jx, set(v)));
        const auto r = hn::Sub(hn::Add(hn::Mul(set(gain), b), hn::Mul(weight, set(bias))), a);

        const auto add = [](auto& sum, auto p, auto q) HWY_ATTR { sum = hn::Add(sum, hn::Mul(p, q)); };
        add(jxjx, jx, jx), add(jxjy, jx, jy), add(jxja, jx, ja), add(jyjy, jy, jy), add(jyja, jy, ja);
        add(jaja, ja, ja), add(jxr, jx, r), add(jyr, jy, r), add(jar, ja, r);
        n = hn::Add(n, weight), sa = hn::Add(sa, a), sb = hn::Add(sb, b);
        add(saa, a, a), add(sab, a, b), add(sbb, b, b);
      }
    }
    const auto store = [&](int i, auto sum) HWY_ATTR { hn::Store(sum, kFloats, columns[i] + part); };
    store(Sums::kJxJx, jxjx), store(Sums::kJxJy, jxjy), store(Sums::kJxJa, jxja), store(Sums::kJyJy, jyjy);
    store(Sums::kJyJa, jyja), store(Sums::kJaJa, jaja), store(Sums::kJxR, jxr), store(Sums::kJyR, jyr);
    store(Sums::kJaR, jar), store(Sums::kN, n), store(Sums::kA, sa), store(Sums::kB, sb);
    store(Sums::kAA, saa), store(Sums::kAB, sab), store(Sums::kBB, sbb);
  }
  for (int i = 0; i < Sums::kCount; ++i) {
    float sum = 0;
    for (const float column : columns[i]) sum += column;
    sums->v[i] = sum;
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace raysfm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace raysfm {

HWY_EXPORT(sum_residuals);

namespace {
using coarse::Motion;
using coarse::Sums;

constexpr int kMinSide = 8;        // pixels; smaller levels say nothing
constexpr int kMaxIterations = 6;  // per level
constexpr float kStopPx = 0.02f;   // of the level
constexpr float kMaxAngle = 0.6f;  // radians; beyond it the search has left its basin

struct Fit {
  Motion motion;
  float zncc = 0;
};

// Gauss-Newton in the inverse compositional form on one level.
Fit refine(const GrayView& first, const GrayView& second, Motion motion) {
  Fit fit;
  float gain = 1, bias = 0;
  Sums s;
  // The first pass only finds gain and bias.
  for (int iteration = 0; iteration <= kMaxIterations; ++iteration) {
    HWY_DYNAMIC_DISPATCH(sum_residuals)(first, second, motion, gain, bias, &s);
    const float n = s.v[Sums::kN];
    if (n < 0.25f * static_cast<float>(first.width * first.height)) return {};
    const float mean_a = s.v[Sums::kA] / n, mean_b = s.v[Sums::kB] / n;
    const float aa = s.v[Sums::kAA] / n - mean_a * mean_a, bb = s.v[Sums::kBB] / n - mean_b * mean_b;
    const float ab = s.v[Sums::kAB] / n - mean_a * mean_b;
    if (!(aa > 1 && bb > 1 && ab > 0)) return {};
    fit = {motion, std::min(1.0f, ab / std::sqrt(aa * bb))};
    gain = std::sqrt(aa / bb);
    bias = mean_a - gain * mean_b;
    if (iteration == 0) continue;

    Eigen::Matrix3f normal;
    normal << s.v[Sums::kJxJx], s.v[Sums::kJxJy], s.v[Sums::kJxJa],  //
        s.v[Sums::kJxJy], s.v[Sums::kJyJy], s.v[Sums::kJyJa],        //
        s.v[Sums::kJxJa], s.v[Sums::kJyJa], s.v[Sums::kJaJa];
    const Eigen::Vector3f step =
        normal.ldlt().solve(Eigen::Vector3f(s.v[Sums::kJxR], s.v[Sums::kJyR], s.v[Sums::kJaR]));
    if (!step.allFinite()) return {};
    // The motion after the inverse of the step.
    motion.angle -= step.z();
    const float cosine = std::cos(motion.angle), sine = std::sin(motion.angle);
    motion.x -= cosine * step.x() - sine * step.y();
    motion.y -= sine * step.x() + cosine * step.y();
    if (std::abs(motion.angle) > kMaxAngle) return {};
    const float turn = std::abs(step.z()) * 0.5f * static_cast<float>(first.width);
    if (std::max({std::abs(step.x()), std::abs(step.y()), turn}) < kStopPx) break;
  }
  fit.motion = motion;
  return fit;
}

// The image and its halves, the coarsest small enough for the search of shifts. Copies, because the vectors
// read a little behind the rows.
std::vector<GrayImage> make_levels(const GrayView& image) {
  std::vector<GrayImage> levels(1);
  make_thumbnail(image, image.width, &levels[0]);
  while (std::max(levels.back().width(), levels.back().height()) > kMaxShiftSearchSide) {
    GrayImage half;
    half_sample(levels.back().view(), &half);
    levels.push_back(std::move(half));
  }
  return levels;
}

}  // namespace

Eigen::Vector2f CoarseMotion::apply(const Eigen::Vector2f& pixel, int width, int height) const {
  const Eigen::Vector2f centre(0.5f * static_cast<float>(width - 1), 0.5f * static_cast<float>(height - 1));
  const Eigen::Vector2f d = pixel - centre;
  const float cosine = std::cos(angle), sine = std::sin(angle);
  return centre + Eigen::Vector2f(cosine * d.x() - sine * d.y(), sine * d.x() + cosine * d.y()) + shift;
}

CoarseMotion estimate_coarse_motion(const GrayView& first, const GrayView& second, float scale) {
  CoarseMotion result;
  if (first.width != second.width || first.height != second.height || first.empty()) return result;
  const std::vector<GrayImage> a = make_levels(first), b = make_levels(second);
  if (std::min(a.back().width(), a.back().height()) < kMinSide) return result;

  const ShiftSearchResult start = search_shift(a.back().view(), b.back().view());
  if (!(start.zncc > 0)) return result;
  Fit fit{{static_cast<float>(start.shift.x()), static_cast<float>(start.shift.y()), 0}, start.zncc};
  for (size_t level = a.size(); level-- > 0;) {
    fit = refine(a[level].view(), b[level].view(), fit.motion);
    if (!(fit.zncc > 0)) return result;
    if (level > 0) {
      fit.motion.x *= 2;
      fit.motion.y *= 2;
    }
  }
  return {scale * Eigen::Vector2f(fit.motion.x, fit.motion.y), fit.motion.angle, fit.zncc};
}

}  // namespace raysfm
#endif  // HWY_ONCE
