#include "raysfm/solvers/generalised_p3p.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "raysfm/solvers/p3p.h"
#include "raysfm/solvers/polynomial_roots.h"

namespace raysfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// The law of cosines of rays i and j of the sample, as
//   t_i^2 + t_j^2 - 2 cosine t_i t_j + linear_i t_i + linear_j t_j + constant = 0.
struct Law {
  double cosine, linear_i, linear_j, constant;

  double value(double ti, double tj) const {
    return ti * (ti + linear_i) + tj * (tj + linear_j) - 2 * cosine * ti * tj + constant;
  }
};

// Lengths are divided by `scale`.
Law law_of(const Ray& i, const Ray& j, double squared_distance, double scale) {
  const Vector3d apart = (i.origin - j.origin) / scale;
  return {i.direction.dot(j.direction), 2 * apart.dot(i.direction), -2 * apart.dot(j.direction),
          apart.squaredNorm() - squared_distance};
}

// Polynomial of degree N by its coefficients, the constant first.
template <int N>
using Polynomial = std::array<double, N + 1>;

template <size_t A, size_t B>
std::array<double, A + B - 1> product(const std::array<double, A>& a, const std::array<double, B>& b) {
  std::array<double, A + B - 1> c{};
  for (size_t i = 0; i < A; ++i) {
    for (size_t j = 0; j < B; ++j) c[i + j] += a[i] * b[j];
  }
  return c;
}

template <size_t A, size_t B>
void add(double factor, const std::array<double, B>& b, std::array<double, A>* a) {
  static_assert(B <= A);
  for (size_t i = 0; i < B; ++i) (*a)[i] += factor * b[i];
}

template <size_t A>
double value(const std::array<double, A>& p, double x) {
  double sum = p[A - 1];
  for (size_t i = A - 1; i-- > 0;) sum = sum * x + p[i];
  return sum;
}

// The elimination. With x = t_0, laws 01 and 02 read
//   t_1^2 + p t_1 + q = 0,   t_2^2 + r t_2 + s = 0,   p, r linear and q, s quadratic in x,
// which turn law 12 into N + M t_2 = 0 with N = a t_1 + e, M = b - 2 c t_1. Then N^2 - r N M + s M^2 = 0,
// reduced by t_1's quadratic, is u t_1 + v = 0, and v^2 - p u v + q u^2 = 0 is the polynomial.
struct Elimination {
  Polynomial<1> a, b;
  Polynomial<2> e;
  double c;
  Polynomial<3> u{};
  Polynomial<4> v{};
  Polynomial<8> octic{};

  Elimination(const Law& law01, const Law& law02, const Law& law12) {
    const Polynomial<1> p = {law01.linear_j, -2 * law01.cosine}, r = {law02.linear_j, -2 * law02.cosine};
    const Polynomial<2> q = {law01.constant, law01.linear_i, 1}, s = {law02.constant, law02.linear_i, 1};
    a = {law12.linear_i - p[0], -p[1]};
    b = {law12.linear_j - r[0], -r[1]};
    e = {law12.constant - q[0] - s[0], -q[1] - s[1], -q[2] - s[2]};
    c = law12.cosine;
    // Coefficients of t_1^2, t_1 and 1.
    Polynomial<2> square = product(a, a);
    add(2 * c, product(r, a), &square);
    add(4 * c * c, s, &square);
    u = product(a, e);
    for (double& x : u) x *= 2;
    Polynomial<2> mixed = product(a, b);
    add(-2 * c, e, &mixed);
    add(-1, product(r, mixed), &u);
    add(-4 * c, product(b, s), &u);
    v = product(e, e);
    add(-1, product(r, product(e, b)), &v);
    add(1, product(product(b, b), s), &v);
    add(-1, product(square, p), &u);
    add(-1, product(square, q), &v);
    octic = product(v, v);
    add(-1, product(p, product(u, v)), &octic);
    add(1, product(q, product(u, u)), &octic);
  }
};

// Newton's iteration on the three laws. False where it does not arrive at positive depths.
bool polish(const Law& law01, const Law& law02, const Law& law12, Vector3d* depths) {
  constexpr int kIterations = 5;
  Vector3d& t = *depths;
  for (int k = 0; k < kIterations; ++k) {
    const Vector3d error(law01.value(t[0], t[1]), law02.value(t[0], t[2]), law12.value(t[1], t[2]));
    if (error.cwiseAbs().maxCoeff() <= 1e-14 * (1 + t.squaredNorm())) break;
    const double p = 2 * (t[0] - law01.cosine * t[1]) + law01.linear_i;
    const double q = 2 * (t[1] - law01.cosine * t[0]) + law01.linear_j;
    const double r = 2 * (t[0] - law02.cosine * t[2]) + law02.linear_i;
    const double s = 2 * (t[2] - law02.cosine * t[0]) + law02.linear_j;
    const double v = 2 * (t[1] - law12.cosine * t[2]) + law12.linear_i;
    const double w = 2 * (t[2] - law12.cosine * t[1]) + law12.linear_j;
    // Jacobian [p q 0; r 0 s; 0 v w].
    const double determinant = -p * s * v - q * r * w;
    if (determinant == 0) return false;
    t -= Vector3d(-s * v * error[0] - q * w * error[1] + q * s * error[2],
                  -r * w * error[0] + p * w * error[1] - p * s * error[2],
                  r * v * error[0] - p * v * error[1] - q * r * error[2]) /
         determinant;
  }
  const double size2 = 1 + t.squaredNorm();
  return t.minCoeff() > 0 && std::abs(law01.value(t[0], t[1])) <= 1e-9 * size2 &&
         std::abs(law02.value(t[0], t[2])) <= 1e-9 * size2 &&
         std::abs(law12.value(t[1], t[2])) <= 1e-9 * size2;
}

}  // namespace

int generalised_p3p(std::span<const Ray, 3> rays, std::span<const Vector3d, 3> points,
                    std::array<Rigid3, kMaxGeneralisedP3pPoses>* rig_from_world) {
  constexpr double kMinSine2 = 1e-20;  // of the triangle's angles, squared: collinear points
  const Vector3d edge1 = points[1] - points[0], edge2 = points[2] - points[0];
  const Vector3d normal = edge1.cross(edge2);
  const double length01 = edge1.squaredNorm(), length02 = edge2.squaredNorm(),
               length12 = (points[2] - points[1]).squaredNorm();
  const double scale2 = std::max({length01, length02, length12});
  if (!(normal.squaredNorm() > kMinSine2 * scale2 * scale2)) return 0;

  if (rays[0].origin == rays[1].origin && rays[0].origin == rays[2].origin) {
    const std::array<Vector3d, 3> bearings = {rays[0].direction, rays[1].direction, rays[2].direction};
    std::array<Rigid3, 4> poses;
    const int count = p3p(bearings, points, &poses);
    for (int i = 0; i < count; ++i) {
      (*rig_from_world)[i] = {poses[i].rotation, poses[i].translation + rays[0].origin};
    }
    return count;
  }

  const double scale = std::sqrt(scale2);
  const Law law01 = law_of(rays[0], rays[1], length01 / scale2, scale);
  const Law law02 = law_of(rays[0], rays[2], length02 / scale2, scale);
  const Law law12 = law_of(rays[1], rays[2], length12 / scale2, scale);
  const Elimination elimination(law01, law02, law12);
  std::array<double, kMaxRootDegree> roots;
  const int root_count = real_roots(elimination.octic, roots.data());

  Matrix3d world;  // inverse of (edge1, edge2, normal)
  const Vector3d unit2 = normal / normal.squaredNorm();
  world.row(0) = edge2.cross(unit2);
  world.row(1) = unit2.cross(edge1);
  world.row(2) = unit2;
  int count = 0;
  for (int k = 0; k < root_count && count < kMaxGeneralisedP3pPoses; ++k) {
    const double x = roots[k];
    if (!(x > 0)) continue;
    const double t1 = -value(elimination.v, x) / value(elimination.u, x);
    const double t2 = -(value(elimination.a, x) * t1 + value(elimination.e, x)) /
                      (value(elimination.b, x) - 2 * elimination.c * t1);
    Vector3d depths(x, t1, t2);
    if (!depths.allFinite() || !polish(law01, law02, law12, &depths)) continue;
    std::array<Vector3d, 3> in_rig;
    for (int i = 0; i < 3; ++i) in_rig[i] = rays[i].origin + scale * depths[i] * rays[i].direction;
    Matrix3d rig;
    rig.col(0) = in_rig[1] - in_rig[0];
    rig.col(1) = in_rig[2] - in_rig[0];
    rig.col(2) = rig.col(0).cross(rig.col(1));
    const Eigen::Quaterniond rotation = Eigen::Quaterniond(rig * world).normalized();
    (*rig_from_world)[count++] = {rotation, in_rig[0] - rotation * points[0]};
  }
  return count;
}

}  // namespace raysfm
