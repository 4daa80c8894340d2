#include "raysfm/residuals/normal_kernel.h"

// Vectors without a size at compile time cannot be members of the small structs below.
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV)
#endif
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "raysfm/residuals/normal_kernel.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace raysfm {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using Tag = hn::CappedTag<double, kBlockLanes>;
using Vec = hn::Vec<Tag>;

// Products and sums are never fused: every target gives the same bits.

struct Vec3 {
  Vec x, y, z;
};

HWY_INLINE Vec dot(Vec a0, Vec b0, Vec a1, Vec b1) {
  return hn::Add(hn::Mul(a0, b0), hn::Mul(a1, b1));
}
HWY_INLINE Vec dot(Vec a0, Vec b0, Vec a1, Vec b1, Vec a2, Vec b2) {
  return hn::Add(dot(a0, b0, a1, b1), hn::Mul(a2, b2));
}
HWY_INLINE Vec3 cross(const Vec3& a, const Vec3& b) {
  return {hn::Sub(hn::Mul(a.y, b.z), hn::Mul(a.z, b.y)), hn::Sub(hn::Mul(a.z, b.x), hn::Mul(a.x, b.z)),
          hn::Sub(hn::Mul(a.x, b.y), hn::Mul(a.y, b.x))};
}

void TransformPoints(const double* r, const double* t, ResidualBlock* block) {
  const Tag d;
  double(*x)[kBlockLanes] = block->x;
  for (size_t lane = 0; lane < kBlockLanes; lane += hn::Lanes(d)) {
    const Vec px = hn::Load(d, x[0] + lane), py = hn::Load(d, x[1] + lane), pz = hn::Load(d, x[2] + lane);
    for (int c = 0; c < 3; ++c) {
      const Vec rotated =
          dot(hn::Set(d, r[3 * c]), px, hn::Set(d, r[3 * c + 1]), py, hn::Set(d, r[3 * c + 2]), pz);
      hn::Store(hn::Add(rotated, hn::Set(d, t[c])), d, x[c] + lane);
    }
  }
}

// What both sides need: the rows of A R and of w A, and w r.
struct Rows {
  Vec3 jp0, jp1, wa0, wa1;
  Vec r0, r1;
};

HWY_INLINE Vec3 times_rotation(Tag d, const Vec3& a, const double* r) {
  const auto column = [&](int c) HWY_ATTR {
    return dot(a.x, hn::Set(d, r[c]), a.y, hn::Set(d, r[3 + c]), a.z, hn::Set(d, r[6 + c]));
  };
  return {column(0), column(1), column(2)};
}

// The rows of one vector of lanes; those of A R where the rotation is given.
template <int N>
HWY_INLINE Rows RowsAt(Tag d, const double* rotation, const ObservationBlock<N>& block, size_t lane) {
  const auto load = [&](int k) HWY_ATTR { return hn::Load(d, block.jacobian[k] + lane); };
  const Vec3 a0 = {load(0), load(1), load(2)}, a1 = {load(3), load(4), load(5)};
  const Vec w = hn::Load(d, block.weight + lane);
  return {rotation ? times_rotation(d, a0, rotation) : a0,
          rotation ? times_rotation(d, a1, rotation) : a1,
          {hn::Mul(w, a0.x), hn::Mul(w, a0.y), hn::Mul(w, a0.z)},
          {hn::Mul(w, a1.x), hn::Mul(w, a1.y), hn::Mul(w, a1.z)},
          hn::Mul(w, hn::Load(d, block.residual[0] + lane)),
          hn::Mul(w, hn::Load(d, block.residual[1] + lane))};
}

// Returns the rows after filling block->point for one vector of lanes.
template <int N>
HWY_INLINE Rows PointTermsAt(Tag d, const double* rotation, ObservationBlock<N>* block, size_t lane) {
  const Vec w = hn::Load(d, block->weight + lane);
  const Rows m = RowsAt(d, rotation, *block, lane);
  const Vec3 p0 = m.jp0, p1 = m.jp1;
  const Vec3 w0 = {hn::Mul(w, p0.x), hn::Mul(w, p0.y), hn::Mul(w, p0.z)};
  const Vec3 w1 = {hn::Mul(w, p1.x), hn::Mul(w, p1.y), hn::Mul(w, p1.z)};
  const auto store = [&](int k, Vec v) HWY_ATTR { hn::Store(v, d, block->point[k] + lane); };
  store(0, dot(w0.x, p0.x, w1.x, p1.x));
  store(1, dot(w0.x, p0.y, w1.x, p1.y));
  store(2, dot(w0.x, p0.z, w1.x, p1.z));
  store(3, dot(w0.y, p0.y, w1.y, p1.y));
  store(4, dot(w0.y, p0.z, w1.y, p1.z));
  store(5, dot(w0.z, p0.z, w1.z, p1.z));
  store(6, dot(p0.x, m.r0, p1.x, m.r1));
  store(7, dot(p0.y, m.r0, p1.y, m.r1));
  store(8, dot(p0.z, m.r0, p1.z, m.r1));
  return m;
}

template <int N>
void PointTerms(const double* rotation, ObservationBlock<N>* block) {
  const Tag d;
  for (size_t lane = 0; lane < kBlockLanes; lane += hn::Lanes(d)) PointTermsAt(d, rotation, block, lane);
}

// W = [M R; [x]x M R] with M = w A^T A, by columns: M R e_c = (w A)^T (Jp e_c).
template <int N>
HWY_INLINE void CrossTermsAt(Tag d, const Rows& m, const Vec3& x, ObservationBlock<N>* block, size_t lane) {
  const auto column = [&](int c, Vec jp0, Vec jp1) HWY_ATTR {
    const Vec3 top = {dot(m.wa0.x, jp0, m.wa1.x, jp1), dot(m.wa0.y, jp0, m.wa1.y, jp1),
                      dot(m.wa0.z, jp0, m.wa1.z, jp1)};
    const Vec3 bottom = cross(x, top);
    const Vec values[6] = {top.x, top.y, top.z, bottom.x, bottom.y, bottom.z};
    for (int k = 0; k < 6; ++k) hn::Store(values[k], d, block->cross[N * c + k] + lane);
  };
  column(0, m.jp0.x, m.jp1.x);
  column(1, m.jp0.y, m.jp1.y);
  column(2, m.jp0.z, m.jp1.z);
}

// U = [M, .; N, N [x]x^T] with N = [x]x M; gc = (g, x x g) with g = w A^T r.
template <int N>
HWY_INLINE void PoseTermsAt(Tag d, const Rows& m, const Vec3& x, const ObservationBlock<N>& block,
                            PoseSums<N>* sums, size_t lane) {
  const auto load = [&](int k) HWY_ATTR { return hn::Load(d, block.jacobian[k] + lane); };
  const Vec3 a0 = {load(0), load(1), load(2)}, a1 = {load(3), load(4), load(5)};
  const auto add = [&](int k, Vec v) HWY_ATTR {
    hn::Store(hn::Add(hn::Load(d, sums->sum[k] + lane), v), d, sums->sum[k] + lane);
  };
  const Vec xx = dot(m.wa0.x, a0.x, m.wa1.x, a1.x), xy = dot(m.wa0.x, a0.y, m.wa1.x, a1.y),
            xz = dot(m.wa0.x, a0.z, m.wa1.x, a1.z), yy = dot(m.wa0.y, a0.y, m.wa1.y, a1.y),
            yz = dot(m.wa0.y, a0.z, m.wa1.y, a1.z), zz = dot(m.wa0.z, a0.z, m.wa1.z, a1.z);
  add(0, xx), add(1, xy), add(2, xz), add(3, yy), add(4, yz), add(5, zz);
  const Vec3 n0 = cross(x, {xx, xy, xz}), n1 = cross(x, {xy, yy, yz}),
             n2 = cross(x, {xz, yz, zz});  // columns
  add(6, n0.x), add(7, n0.y), add(8, n0.z);
  add(9, n1.x), add(10, n1.y), add(11, n1.z);
  add(12, n2.x), add(13, n2.y), add(14, n2.z);
  const Vec3 u0 = cross(x, {n0.x, n1.x, n2.x}), u1 = cross(x, {n0.y, n1.y, n2.y}),
             u2 = cross(x, {n0.z, n1.z, n2.z});
  add(15, u0.x), add(16, u0.y), add(17, u0.z), add(18, u1.y), add(19, u1.z), add(20, u2.z);
  const Vec3 g = {dot(a0.x, m.r0, a1.x, m.r1), dot(a0.y, m.r0, a1.y, m.r1), dot(a0.z, m.r0, a1.z, m.r1)};
  const Vec3 h = cross(x, g);
  add(21, g.x), add(22, g.y), add(23, g.z), add(24, h.x), add(25, h.y), add(26, h.z);
}

// What B adds: the rows of U, gc and W that belong to the lens.
HWY_INLINE void LensTermsAt(Tag d, const Rows& m, const Vec3& x, ObservationBlock<9>* block,
                            PoseSums<9>* sums, size_t lane) {
  const auto add = [&](int k, Vec v) HWY_ATTR {
    hn::Store(hn::Add(hn::Load(d, sums->sum[k] + lane), v), d, sums->sum[k] + lane);
  };
  const auto store = [&](int column, int row, Vec v)
                         HWY_ATTR { hn::Store(v, d, block->cross[9 * column + row] + lane); };
  const auto load = [&](int k) HWY_ATTR { return hn::Load(d, block->lens[k] + lane); };
  const Vec w = hn::Load(d, block->weight + lane);
  const Vec b0[3] = {load(0), load(1), load(2)}, b1[3] = {load(3), load(4), load(5)};
  for (int i = 0, k = 45; i < 3; ++i) {
    const Vec3 top = {dot(m.wa0.x, b0[i], m.wa1.x, b1[i]), dot(m.wa0.y, b0[i], m.wa1.y, b1[i]),
                      dot(m.wa0.z, b0[i], m.wa1.z, b1[i])};
    const Vec3 bottom = cross(x, top);
    add(27 + 6 * i, top.x), add(28 + 6 * i, top.y), add(29 + 6 * i, top.z);
    add(30 + 6 * i, bottom.x), add(31 + 6 * i, bottom.y), add(32 + 6 * i, bottom.z);
    const Vec wb0 = hn::Mul(w, b0[i]), wb1 = hn::Mul(w, b1[i]);
    for (int j = i; j < 3; ++j) add(k++, dot(wb0, b0[j], wb1, b1[j]));
    add(51 + i, dot(b0[i], m.r0, b1[i], m.r1));
    store(0, 6 + i, dot(wb0, m.jp0.x, wb1, m.jp1.x));
    store(1, 6 + i, dot(wb0, m.jp0.y, wb1, m.jp1.y));
    store(2, 6 + i, dot(wb0, m.jp0.z, wb1, m.jp1.z));
  }
}

HWY_INLINE Vec3 PointAt(Tag d, const ResidualBlock& block, size_t lane) {
  return {hn::Load(d, block.x[0] + lane), hn::Load(d, block.x[1] + lane), hn::Load(d, block.x[2] + lane)};
}

void PoseTerms6(const ObservationBlock<6>& block, PoseSums<6>* sums) {
  const Tag d;
  for (size_t lane = 0; lane < kBlockLanes; lane += hn::Lanes(d)) {
    PoseTermsAt(d, RowsAt(d, nullptr, block, lane), PointAt(d, block, lane), block, sums, lane);
  }
}

template <int N>
void PointAndPoseTerms(const double* rotation, ObservationBlock<N>* block, PoseSums<N>* sums) {
  const Tag d;
  for (size_t lane = 0; lane < kBlockLanes; lane += hn::Lanes(d)) {
    const Rows m = PointTermsAt(d, rotation, block, lane);
    const Vec3 x = PointAt(d, *block, lane);
    CrossTermsAt(d, m, x, block, lane);
    PoseTermsAt(d, m, x, *block, sums, lane);
    if constexpr (N == 9) LensTermsAt(d, m, x, block, sums, lane);
  }
}

// One name for each, as the dispatch wants.
void PointTerms6(const double* rotation, ObservationBlock<6>* block) {
  PointTerms(rotation, block);
}
void PointTerms9(const double* rotation, ObservationBlock<9>* block) {
  PointTerms(rotation, block);
}
void PointAndPoseTerms6(const double* rotation, ObservationBlock<6>* block, PoseSums<6>* sums) {
  PointAndPoseTerms(rotation, block, sums);
}
void PointAndPoseTerms9(const double* rotation, ObservationBlock<9>* block, PoseSums<9>* sums) {
  PointAndPoseTerms(rotation, block, sums);
}

}  // namespace HWY_NAMESPACE
}  // namespace raysfm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace raysfm {
namespace {

HWY_EXPORT(TransformPoints);
HWY_EXPORT(PointTerms6);
HWY_EXPORT(PointTerms9);
HWY_EXPORT(PoseTerms6);
HWY_EXPORT(PointAndPoseTerms6);
HWY_EXPORT(PointAndPoseTerms9);

double lane_sum(const double* lanes) {
  double sum = lanes[0];
  for (int i = 1; i < kBlockLanes; ++i) sum += lanes[i];
  return sum;
}

struct Place {
  int row, column;
};
// Of the sums in U, those of the lens after gc.
constexpr Place kPosePlaces[21] = {{0, 0}, {1, 0}, {2, 0}, {1, 1}, {2, 1}, {2, 2}, {3, 0},
                                   {4, 0}, {5, 0}, {3, 1}, {4, 1}, {5, 1}, {3, 2}, {4, 2},
                                   {5, 2}, {3, 3}, {4, 3}, {5, 3}, {4, 4}, {5, 4}, {5, 5}};
constexpr Place kLensPlaces[24] = {{6, 0}, {6, 1}, {6, 2}, {6, 3}, {6, 4}, {6, 5}, {7, 0}, {7, 1},
                                   {7, 2}, {7, 3}, {7, 4}, {7, 5}, {8, 0}, {8, 1}, {8, 2}, {8, 3},
                                   {8, 4}, {8, 5}, {6, 6}, {7, 6}, {8, 6}, {7, 7}, {8, 7}, {8, 8}};

}  // namespace

void transform_points(const double* rotation, const double* translation, ResidualBlock* block) {
  HWY_DYNAMIC_DISPATCH(TransformPoints)(rotation, translation, block);
}

template <>
void point_terms<6>(const double* rotation, ObservationBlock<6>* block) {
  HWY_DYNAMIC_DISPATCH(PointTerms6)(rotation, block);
}
template <>
void point_terms<9>(const double* rotation, ObservationBlock<9>* block) {
  HWY_DYNAMIC_DISPATCH(PointTerms9)(rotation, block);
}

void pose_terms(const ObservationBlock<6>& block, PoseSums<6>* sums) {
  HWY_DYNAMIC_DISPATCH(PoseTerms6)(block, sums);
}

template <>
void point_and_pose_terms<6>(const double* rotation, ObservationBlock<6>* block, PoseSums<6>* sums) {
  HWY_DYNAMIC_DISPATCH(PointAndPoseTerms6)(rotation, block, sums);
}
template <>
void point_and_pose_terms<9>(const double* rotation, ObservationBlock<9>* block, PoseSums<9>* sums) {
  HWY_DYNAMIC_DISPATCH(PointAndPoseTerms9)(rotation, block, sums);
}

template <int N>
void add_pose_sums(const PoseSums<N>& sums, double* u, double* gradient) {
  const auto add = [&](const Place& place, int k) {
    u[N * place.column + place.row] += lane_sum(sums.sum[k]);
  };
  for (int k = 0; k < 21; ++k) add(kPosePlaces[k], k);
  for (int k = 0; k < 6; ++k) gradient[k] += lane_sum(sums.sum[21 + k]);
  if constexpr (N == 9) {
    for (int k = 0; k < 24; ++k) add(kLensPlaces[k], 27 + k);
    for (int k = 0; k < 3; ++k) gradient[6 + k] += lane_sum(sums.sum[51 + k]);
  }
}
template void add_pose_sums<6>(const PoseSums<6>& sums, double* u, double* gradient);
template void add_pose_sums<9>(const PoseSums<9>& sums, double* u, double* gradient);

}  // namespace raysfm
#endif  // HWY_ONCE
