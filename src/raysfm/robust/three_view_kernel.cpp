#include "raysfm/robust/three_view_kernel.h"

#include <cstddef>
#include <limits>

// Vectors without a size at compile time cannot be members of the small structs below.
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV)
#endif
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "raysfm/robust/three_view_kernel.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace raysfm {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using PointTag = hn::CappedTag<double, kPointLanes>;
using Number = hn::Vec<PointTag>;
using Lane = ThreeViewPoints::Lane;

// Products and sums are never fused, and lanes are added in their order: every target gives the same bits.

struct Vector {
  Number x, y, z;
};

HWY_INLINE Number set(double value) {
  return hn::Set(PointTag(), value);
}
HWY_INLINE Number zero() {
  return hn::Zero(PointTag());
}
HWY_INLINE Number load(const Lane& lane, size_t k) {
  return hn::Load(PointTag(), lane + k);
}
HWY_INLINE void store(Number value, size_t k, Lane& lane) {
  hn::Store(value, PointTag(), lane + k);
}
HWY_INLINE void add_to(Number value, size_t k, Lane& lane) {
  store(hn::Add(load(lane, k), value), k, lane);
}
HWY_INLINE Vector load(const Lane (&lanes)[3], size_t k) {
  return {load(lanes[0], k), load(lanes[1], k), load(lanes[2], k)};
}

HWY_INLINE Number dot(const Vector& a, const Vector& b) {
  return hn::Add(hn::Add(hn::Mul(a.x, b.x), hn::Mul(a.y, b.y)), hn::Mul(a.z, b.z));
}
HWY_INLINE Number dot(const Vector& a, const double* b) {
  return dot(a, Vector{set(b[0]), set(b[1]), set(b[2])});
}
HWY_INLINE Vector times(Number s, const Vector& a) {
  return {hn::Mul(s, a.x), hn::Mul(s, a.y), hn::Mul(s, a.z)};
}
HWY_INLINE Vector plus(const Vector& a, const Vector& b) {
  return {hn::Add(a.x, b.x), hn::Add(a.y, b.y), hn::Add(a.z, b.z)};
}
HWY_INLINE Vector minus(const Vector& a, const Vector& b) {
  return {hn::Sub(a.x, b.x), hn::Sub(a.y, b.y), hn::Sub(a.z, b.z)};
}
HWY_INLINE Vector cross(const Vector& a, const Vector& b) {
  return {hn::Sub(hn::Mul(a.y, b.z), hn::Mul(a.z, b.y)), hn::Sub(hn::Mul(a.z, b.x), hn::Mul(a.x, b.z)),
          hn::Sub(hn::Mul(a.x, b.y), hn::Mul(a.y, b.x))};
}
HWY_INLINE Vector rotated(const double* r, const Vector& a) {
  return {dot(a, r), dot(a, r + 3), dot(a, r + 6)};
}
HWY_INLINE Vector constant(const std::array<double, 3>& a) {
  return {set(a[0]), set(a[1]), set(a[2])};
}

// In view 0, up to the distance.
HWY_INLINE Vector direction(const ThreeViewPoints& points, const Lane (&place)[3], size_t k) {
  const Vector moved = plus(times(load(place[0], k), load(points.tangents[0][0], k)),
                            times(load(place[1], k), load(points.tangents[0][1], k)));
  return plus(load(points.bearings[0], k), moved);
}

HWY_INLINE Vector seen_by(const ThreeViewPoses& poses, int view, const Vector& direction,
                          Number inverse_distance) {
  if (view == 0) return direction;
  return plus(rotated(poses.rotations[view - 1].data(), direction),
              times(inverse_distance, constant(poses.translations[view - 1])));
}

// What one view says of one vector of points.
struct Seen {
  Number residual[2];
  Vector by_seen[2];
};

HWY_INLINE Seen look(const ThreeViewPoints& points, int view, const Vector& seen, size_t k) {
  const Vector bearing = load(points.bearings[view], k);
  const Number per_length = hn::Div(set(1), dot(bearing, seen));
  Seen s;
  for (int row = 0; row < 2; ++row) {
    const Vector tangent = load(points.tangents[view][row], k);
    s.residual[row] = hn::Mul(dot(tangent, seen), per_length);
    s.by_seen[row] = times(per_length, minus(tangent, times(s.residual[row], bearing)));
  }
  return s;
}

// Upper triangles by rows.
struct Sums {
  Lane poses[kHessianNumbers] = {}, points[kHessianNumbers] = {}, gradient[kPoseNumbers] = {};
};

HWY_INLINE constexpr int upper(int row, int column) {
  return row * kPoseNumbers - row * (row - 1) / 2 + column - row;
}

// Equations of one vector of points.
struct PointPart {
  Number own[6];  // upper triangle by rows
  Number gradient[3];
};

// Adds what a view says of the point.
HWY_INLINE void add_point_part(const Number (&by_point)[2][3], const Seen& s, PointPart* part) {
  int at = 0;
  for (int i = 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j, ++at) {
      part->own[at] = hn::Add(part->own[at], hn::Add(hn::Mul(by_point[0][i], by_point[0][j]),
                                                     hn::Mul(by_point[1][i], by_point[1][j])));
    }
    part->gradient[i] = hn::Add(part->gradient[i], hn::Add(hn::Mul(by_point[0][i], s.residual[0]),
                                                           hn::Mul(by_point[1][i], s.residual[1])));
  }
}

// Adds what a view says of its pose, kSize numbers from kBegin on.
template <int kBegin, int kSize>
HWY_INLINE void add_pose_part(const Number (&by_pose)[2][kSize], const Number (&by_point)[2][3],
                              const Seen& s, size_t k, ThreeViewPoints* points, Sums* sums) {
  for (int i = 0; i < kSize; ++i) {
    for (int j = i; j < kSize; ++j) {
      add_to(hn::Add(hn::Mul(by_pose[0][i], by_pose[0][j]), hn::Mul(by_pose[1][i], by_pose[1][j])), k,
             sums->poses[upper(kBegin + i, kBegin + j)]);
    }
    add_to(hn::Add(hn::Mul(by_pose[0][i], s.residual[0]), hn::Mul(by_pose[1][i], s.residual[1])), k,
           sums->gradient[kBegin + i]);
    for (int c = 0; c < 3; ++c) {
      store(hn::Add(hn::Mul(by_point[0][c], by_pose[0][i]), hn::Mul(by_point[1][c], by_pose[1][i])), k,
            points->by_poses[c][kBegin + i]);
    }
  }
}

// Of a symmetric matrix, by its adjugate.
HWY_INLINE void invert(const Number (&a)[6], Number (&inverse)[6]) {
  const auto minor = [](Number p, Number q, Number r, Number s)
                         HWY_ATTR { return hn::Sub(hn::Mul(p, q), hn::Mul(r, s)); };
  const Number c00 = minor(a[3], a[5], a[4], a[4]), c01 = minor(a[2], a[4], a[1], a[5]),
               c02 = minor(a[1], a[4], a[2], a[3]);
  const Number determinant = dot(Vector{a[0], a[1], a[2]}, Vector{c00, c01, c02});
  const Number scale = hn::Div(set(1), determinant);
  inverse[0] = hn::Mul(scale, c00);
  inverse[1] = hn::Mul(scale, c01);
  inverse[2] = hn::Mul(scale, c02);
  inverse[3] = hn::Mul(scale, minor(a[0], a[5], a[2], a[2]));
  inverse[4] = hn::Mul(scale, minor(a[1], a[2], a[0], a[4]));
  inverse[5] = hn::Mul(scale, minor(a[0], a[3], a[1], a[1]));
}

HWY_INLINE void solve(const Lane (&inverse)[6], size_t k, const Vector& right, Number (&solution)[3]) {
  const Vector rows[3] = {{load(inverse[0], k), load(inverse[1], k), load(inverse[2], k)},
                          {load(inverse[1], k), load(inverse[3], k), load(inverse[4], k)},
                          {load(inverse[2], k), load(inverse[4], k), load(inverse[5], k)}};
  for (int i = 0; i < 3; ++i) solution[i] = dot(rows[i], right);
}

HWY_INLINE void eliminate(const PointPart& part, double damping, size_t k, ThreeViewPoints* points,
                          Sums* sums) {
  constexpr double kLeast = 1e-12;  // a point on the baseline has no distance
  Number own[6], inverse[6];
  for (int i = 0; i < 6; ++i) own[i] = part.own[i];
  for (const int i : {0, 3, 5}) own[i] = hn::Add(hn::Mul(set(1 + damping), own[i]), set(kLeast));
  invert(own, inverse);
  for (int i = 0; i < 6; ++i) store(inverse[i], k, points->inverse[i]);
  for (int i = 0; i < 3; ++i) store(part.gradient[i], k, points->gradient[i]);
  const Vector gradient = {part.gradient[0], part.gradient[1], part.gradient[2]};
  for (int i = 0; i < kPoseNumbers; ++i) {
    const Vector of_pose = {load(points->by_poses[0][i], k), load(points->by_poses[1][i], k),
                            load(points->by_poses[2][i], k)};
    Number solved[3];
    solve(points->inverse, k, of_pose, solved);
    const Vector eliminated = {solved[0], solved[1], solved[2]};
    add_to(hn::Neg(dot(eliminated, gradient)), k, sums->gradient[i]);
    for (int j = i; j < kPoseNumbers; ++j) {
      const Vector other = {load(points->by_poses[0][j], k), load(points->by_poses[1][j], k),
                            load(points->by_poses[2][j], k)};
      add_to(dot(eliminated, other), k, sums->points[upper(i, j)]);
    }
  }
}

// What a view's own rows say of the point: along the tangents of view 0 and by the inverse distance.
HWY_INLINE void differentiate_by_point(const ThreeViewPoses& poses, const ThreeViewPoints& points, int view,
                                       const Seen& s, size_t k, Number (&by_point)[2][3]) {
  for (int row = 0; row < 2; ++row) {
    for (int j = 0; j < 2; ++j) {
      const Vector tangent = load(points.tangents[0][j], k);
      by_point[row][j] =
          dot(s.by_seen[row], view == 0 ? tangent : rotated(poses.rotations[view - 1].data(), tangent));
    }
    by_point[row][2] = view == 0 ? zero() : dot(s.by_seen[row], poses.translations[view - 1].data());
  }
}

HWY_INLINE void linearise_at(const ThreeViewPoses& poses, double damping, size_t k, ThreeViewPoints* points,
                             Sums* sums) {
  const Number inverse_distance = load(points->place[2], k);
  const Vector in_view_0 = direction(*points, points->place, k);
  PointPart part;
  for (Number& n : part.own) n = zero();
  for (Number& n : part.gradient) n = zero();
  Number by_point[2][3];
  for (int view = 0; view < 3; ++view) {
    const Vector seen = seen_by(poses, view, in_view_0, inverse_distance);
    const Seen s = look(*points, view, seen, k);
    differentiate_by_point(poses, *points, view, s, k, by_point);
    add_point_part(by_point, s, &part);
    if (view == 0) continue;
    // Rotation w and translation v move what is seen by w x seen + rho v.
    Vector by_translation[2], by_rotation[2];
    for (int row = 0; row < 2; ++row) {
      by_translation[row] = times(inverse_distance, s.by_seen[row]);
      by_rotation[row] = cross(seen, s.by_seen[row]);
    }
    const auto rotation = [&](int row, int i) HWY_ATTR {
      return i == 0 ? by_rotation[row].x : i == 1 ? by_rotation[row].y : by_rotation[row].z;
    };
    if (view == 1) {
      Number by_pose[2][6];
      for (int row = 0; row < 2; ++row) {
        by_pose[row][0] = by_translation[row].x;
        by_pose[row][1] = by_translation[row].y;
        by_pose[row][2] = by_translation[row].z;
        for (int i = 0; i < 3; ++i) by_pose[row][3 + i] = rotation(row, i);
      }
      add_pose_part<0, 6>(by_pose, by_point, s, k, points, sums);
    } else {
      Number by_pose[2][5];
      for (int row = 0; row < 2; ++row) {
        for (int i = 0; i < 2; ++i)
          by_pose[row][i] = dot(by_translation[row], poses.baseline_tangents[i].data());
        for (int i = 0; i < 3; ++i) by_pose[row][2 + i] = rotation(row, i);
      }
      add_pose_part<6, 5>(by_pose, by_point, s, k, points, sums);
    }
  }
  eliminate(part, damping, k, points, sums);
}

HWY_INLINE double sum_of(const Lane& lane) {
  double sum = 0;
  for (const double value : lane) sum += value;
  return sum;
}

void Linearise(const ThreeViewPoses& poses, double damping, ThreeViewPoints* points, int groups,
               ThreeViewSums* result) {
  alignas(64) Sums sums;
  for (int g = 0; g < groups; ++g) {
    for (size_t k = 0; k < kPointLanes; k += hn::Lanes(PointTag()))
      linearise_at(poses, damping, k, &points[g], &sums);
  }
  for (int i = 0; i < kPoseNumbers; ++i) {
    result->gradient[i] = sum_of(sums.gradient[i]);
    for (int j = i; j < kPoseNumbers; ++j) {
      const double of_poses = sum_of(sums.poses[upper(i, j)]) * (i == j ? 1 + damping : 1);
      result->hessian[upper(i, j)] = of_poses - sum_of(sums.points[upper(i, j)]);
    }
  }
}

void MovePoints(const std::array<double, kPoseNumbers>& step, ThreeViewPoints* points, int groups) {
  for (int g = 0; g < groups; ++g) {
    ThreeViewPoints& p = points[g];
    for (size_t k = 0; k < kPointLanes; k += hn::Lanes(PointTag())) {
      Number right[3], change[3];
      for (int c = 0; c < 3; ++c) {
        right[c] = load(p.gradient[c], k);
        for (int i = 0; i < kPoseNumbers; ++i)
          right[c] = hn::Add(right[c], hn::Mul(load(p.by_poses[c][i], k), set(step[i])));
      }
      solve(p.inverse, k, {right[0], right[1], right[2]}, change);
      for (int c = 0; c < 3; ++c) store(hn::Sub(load(p.place[c], k), change[c]), k, p.moved[c]);
    }
  }
}

double Cost(const ThreeViewPoses& poses, const ThreeViewPoints* points, int groups, bool moved) {
  alignas(64) Lane sums = {};
  for (int g = 0; g < groups; ++g) {
    const auto& place = moved ? points[g].moved : points[g].place;
    for (size_t k = 0; k < kPointLanes; k += hn::Lanes(PointTag())) {
      const Vector in_view_0 = direction(points[g], place, k);
      for (int view = 0; view < 3; ++view) {
        const Vector seen = seen_by(poses, view, in_view_0, load(place[2], k));
        const Number along = dot(load(points[g].bearings[view], k), seen);
        if (!hn::AllTrue(PointTag(), hn::Gt(along, zero()))) return std::numeric_limits<double>::infinity();
        const Seen s = look(points[g], view, seen, k);
        add_to(hn::Add(hn::Mul(s.residual[0], s.residual[0]), hn::Mul(s.residual[1], s.residual[1])), k,
               sums);
      }
    }
  }
  return sum_of(sums);
}

}  // namespace HWY_NAMESPACE
}  // namespace raysfm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace raysfm {

HWY_EXPORT(Linearise);
HWY_EXPORT(MovePoints);
HWY_EXPORT(Cost);

void linearise_three_views(const ThreeViewPoses& poses, double damping, ThreeViewPoints* points, int groups,
                           ThreeViewSums* sums) {
  HWY_DYNAMIC_DISPATCH(Linearise)(poses, damping, points, groups, sums);
}

void move_three_view_points(const std::array<double, kPoseNumbers>& step, ThreeViewPoints* points,
                            int groups) {
  HWY_DYNAMIC_DISPATCH(MovePoints)(step, points, groups);
}

double three_view_cost(const ThreeViewPoses& poses, const ThreeViewPoints* points, int groups, bool moved) {
  return HWY_DYNAMIC_DISPATCH(Cost)(poses, points, groups, moved);
}

}  // namespace raysfm
#endif  // HWY_ONCE
