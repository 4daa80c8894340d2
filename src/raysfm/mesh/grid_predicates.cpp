#include "raysfm/mesh/grid_predicates.h"

#include <cmath>

namespace raysfm {
namespace {

// Of GCC and Clang on every machine of 64 bits; the name keeps -Wpedantic quiet.
__extension__ using Int128 = __int128;

// Terms of the determinants and the sum of their sizes, in doubles, tell the sign nearly always: a sum of
// them is off by less than this part of the sum of sizes, since all differences of coordinates are exact.
constexpr double kRounding = 1e-14;

template <typename T>
using Row = std::array<T, 3>;

template <typename T>
Row<T> difference(const GridPoint& a, const GridPoint& b) {
  return {static_cast<T>(a[0] - b[0]), static_cast<T>(a[1] - b[1]), static_cast<T>(a[2] - b[2])};
}

template <typename T>
int sign_of(T number) {
  return (number > 0) - (number < 0);
}

template <typename T>
T determinant(const Row<T>& a, const Row<T>& b, const Row<T>& c) {
  return a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
         a[2] * (b[0] * c[1] - b[1] * c[0]);
}

// Sum of the sizes of its terms.
double permanent(const Row<double>& a, const Row<double>& b, const Row<double>& c) {
  const auto size = [](double x, double y, double z, double w) { return std::abs(x * y) + std::abs(z * w); };
  return std::abs(a[0]) * size(b[1], c[2], b[2], c[1]) + std::abs(a[1]) * size(b[2], c[0], b[0], c[2]) +
         std::abs(a[2]) * size(b[0], c[1], b[1], c[0]);
}

template <typename T>
T squared_norm(const Row<T>& a) {
  return a[0] * a[0] + a[1] * a[1] + a[2] * a[2];
}

}  // namespace

int orientation(const GridPoint& a, const GridPoint& b, const GridPoint& c, const GridPoint& d) {
  const Row<double> ad = difference<double>(a, d), bd = difference<double>(b, d),
                    cd = difference<double>(c, d);
  const double volume = determinant(ad, bd, cd);
  if (std::abs(volume) > kRounding * permanent(ad, bd, cd)) return sign_of(volume);
  return sign_of(determinant(difference<Int128>(a, d), difference<Int128>(b, d), difference<Int128>(c, d)));
}

int in_sphere(const GridPoint& a, const GridPoint& b, const GridPoint& c, const GridPoint& d,
              const GridPoint& e) {
  const Row<double> ae = difference<double>(a, e), be = difference<double>(b, e),
                    ce = difference<double>(c, e), de = difference<double>(d, e);
  const double a2 = squared_norm(ae), b2 = squared_norm(be), c2 = squared_norm(ce), d2 = squared_norm(de);
  const double inside = d2 * determinant(ae, be, ce) - c2 * determinant(ae, be, de) +
                        b2 * determinant(ae, ce, de) - a2 * determinant(be, ce, de);
  const double size = d2 * permanent(ae, be, ce) + c2 * permanent(ae, be, de) + b2 * permanent(ae, ce, de) +
                      a2 * permanent(be, ce, de);
  if (std::abs(inside) > kRounding * size) return sign_of(inside);
  using Exact = Row<Int128>;
  const Exact ax = difference<Int128>(a, e), bx = difference<Int128>(b, e), cx = difference<Int128>(c, e),
              dx = difference<Int128>(d, e);
  return sign_of(squared_norm(dx) * determinant(ax, bx, cx) - squared_norm(cx) * determinant(ax, bx, dx) +
                 squared_norm(bx) * determinant(ax, cx, dx) - squared_norm(ax) * determinant(bx, cx, dx));
}

}  // namespace raysfm
