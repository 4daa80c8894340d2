#include "raysfm/solvers/polynomial_roots.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <utility>

namespace raysfm {
namespace {

using Coefficients = std::array<double, kMaxRootDegree + 1>;

constexpr double kLargestRoot = 1e9;

// Bisection runs on t in (-1, 1), so that small and large roots take about the same number of steps.
double x_of(double t) {
  return t / (1 - std::abs(t));
}
double t_of(double x) {
  return x / (1 + std::abs(x));
}

// Sturm's sequence f_0 = p, f_1 = p', ..., f_m, kept as the quotients of Euclid's division:
// f_k = (slope_k x + offset_k) f_{k+1} - scale_k f_{k+2}, with scale_k > 0 and f_k of degree n - k. A leading
// coefficient that vanishes is replaced by a tiny one, which is the sequence of a polynomial that differs
// from p by rounding.
class SturmSequence {
 public:
  SturmSequence(const Coefficients& p, int degree) {
    Coefficients f = p, g, h;
    for (int i = 0; i < degree; ++i) g[i] = (i + 1) * p[i + 1];
    for (int d = degree; d > 0; --d) {
      const double slope = f[d] / g[d - 1];
      const double offset = (f[d - 1] - (d > 1 ? slope * g[d - 2] : 0.0)) / g[d - 1];
      slope_[length_] = slope, offset_[length_] = offset;
      const int k = length_++;
      last_degree_ = d - 1;
      double largest = 0;
      for (int i = 0; i <= d - 2; ++i) {
        h[i] = offset * g[i] + (i > 0 ? slope * g[i - 1] : 0.0) - f[i];
        largest = std::max(largest, std::abs(h[i]));
      }
      if (d > 1 && !(largest > 0)) conditioning_ = 0;
      if (!(largest > 0)) break;  // f_{k+1} divides f_k: it is a constant or holds the multiple roots
      scale_[k] = largest;
      conditioning_ = std::min(conditioning_, largest / (std::abs(slope) + std::abs(offset)));
      for (int i = 0; i <= d - 2; ++i) h[i] /= largest;
      if (std::abs(h[d - 2]) < 1e-15) h[d - 2] = 1e-15;
      std::copy_n(g.begin(), d, f.begin());
      std::copy_n(h.begin(), d - 1, g.begin());
    }
    last_ = g;
  }

  // Sign changes at x; between a < b lie changes(a) - changes(b) roots.
  int changes(double x) const {
    double next = last_[last_degree_], after = 0;
    for (int i = last_degree_ - 1; i >= 0; --i) next = next * x + last_[i];
    int count = 0;
    for (int k = length_ - 1; k >= 0; --k) {
      const double value = (slope_[k] * x + offset_[k]) * next - scale_[k] * after;
      count += (value < 0) != (next < 0);
      after = next;
      next = value;
    }
    return count;
  }

  // Smallest remainder relative to the quotient that left it.
  double conditioning() const { return conditioning_; }

 private:
  Coefficients slope_, offset_, scale_ = {}, last_;
  int length_ = 0, last_degree_ = 0;
  double conditioning_ = 1;
};

double evaluate(const Coefficients& p, int degree, double x, double* slope) {
  double value = p[degree], derivative = 0;
  for (int i = degree - 1; i >= 0; --i) {
    derivative = derivative * x + value;
    value = value * x + p[i];
  }
  *slope = derivative;
  return value;
}

// The one root between t_low and t_high.
double refine_root(const Coefficients& p, int degree, double t_low, double t_high) {
  double low = x_of(t_low), high = x_of(t_high), slope;
  const bool negative_low = evaluate(p, degree, low, &slope) < 0;
  double x = x_of(0.5 * (t_low + t_high));
  for (int i = 0; i < 100; ++i) {
    const double value = evaluate(p, degree, x, &slope);
    if (value == 0) return x;
    ((value < 0) == negative_low ? low : high) = x;
    double next = x - value / slope;
    if (!(next > low && next < high)) next = x_of(0.5 * (t_of(low) + t_of(high)));
    const double step = std::abs(next - x);
    x = next;
    if (step <= 1e-14 * std::abs(x)) break;
  }
  return x;
}

struct Interval {
  double t_low, t_high;
  int changes_low, changes_high;
};

}  // namespace

int real_roots(std::span<const double> coefficients, double* roots, double* conditioning) {
  if (conditioning) *conditioning = 0;
  int degree = static_cast<int>(coefficients.size()) - 1;
  assert(degree <= kMaxRootDegree);
  double largest = 0;
  for (const double c : coefficients) {
    if (!std::isfinite(c)) return 0;
    largest = std::max(largest, std::abs(c));
  }
  while (degree > 0 && !(std::abs(coefficients[degree]) > 1e-16 * largest)) --degree;
  if (degree < 1) return 0;
  Coefficients p;
  for (int i = 0; i <= degree; ++i) p[i] = coefficients[i] / largest;

  constexpr double kSmallestInterval = 1e-13;
  const SturmSequence sturm(p, degree);
  if (conditioning) *conditioning = sturm.conditioning();
  const double end = t_of(kLargestRoot);
  std::array<Interval, 64> stack;  // each bisection adds one, and halves the interval, down to 1e-13
  stack[0] = {-end, end, sturm.changes(-kLargestRoot), sturm.changes(kLargestRoot)};
  int size = 1, count = 0;
  while (size > 0 && count < degree) {
    const Interval interval = stack[--size];
    const auto [low, high, changes_low, changes_high] = interval;
    if (changes_low <= changes_high) continue;
    if (changes_low - changes_high == 1 || high - low < kSmallestInterval) {
      roots[count++] = refine_root(p, degree, low, high);
      continue;
    }
    const double middle = 0.5 * (low + high);
    const int changes_middle = sturm.changes(x_of(middle));
    stack[size++] = {middle, high, changes_middle, changes_high};
    stack[size++] = {low, middle, changes_low, changes_middle};
  }
  return count;
}

}  // namespace raysfm
