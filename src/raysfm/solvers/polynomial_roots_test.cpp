#include "raysfm/solvers/polynomial_roots.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "raysfm/core/random.h"

namespace raysfm {
namespace {

std::vector<double> solve(const std::vector<double>& coefficients) {
  std::array<double, kMaxRootDegree> roots;
  const int count = real_roots(coefficients, roots.data());
  return {roots.begin(), roots.begin() + count};
}

std::vector<double> multiply(const std::vector<double>& a, const std::vector<double>& b) {
  std::vector<double> product(a.size() + b.size() - 1, 0.0);
  for (size_t i = 0; i < a.size(); ++i) {
    for (size_t j = 0; j < b.size(); ++j) product[i + j] += a[i] * b[j];
  }
  return product;
}

TEST(RealRoots, FindsExactlyTheRealRootsItWasBuiltFrom) {
  Rng rng(1);
  int failures = 0;
  for (int trial = 0; trial < 5000; ++trial) {
    std::vector<double> polynomial = {rng.uniform(-2, 2)}, truth;
    const int real = static_cast<int>(rng.index(7)), pairs = static_cast<int>(rng.index((10 - real) / 2 + 1));
    for (int i = 0; i < real; ++i) {
      truth.push_back(std::tan(1.5 * rng.uniform(-1, 1)));
      polynomial = multiply(polynomial, {-truth.back(), 1});
    }
    for (int i = 0; i < pairs; ++i) {
      const double a = rng.normal(), b = rng.uniform(0.2, 2);
      polynomial = multiply(polynomial, {a * a + b * b, -2 * a, 1});
    }
    std::sort(truth.begin(), truth.end());
    const std::vector<double> roots = solve(polynomial);
    bool same = roots.size() == truth.size();
    for (size_t i = 0; same && i < roots.size(); ++i) {
      same = std::abs(roots[i] - truth[i]) < 1e-5 * (1 + std::abs(truth[i]));
    }
    failures += !same;
  }
  EXPECT_LE(failures, 10);  // two roots that almost coincide
}

TEST(RealRoots, SpecialPolynomials) {
  EXPECT_EQ(solve({}), std::vector<double>());
  EXPECT_EQ(solve({3}), std::vector<double>());
  EXPECT_EQ(solve({0, 0, 0}), std::vector<double>());
  EXPECT_EQ(solve({-4, 2}), std::vector<double>({2}));
  EXPECT_EQ(solve({1, 0, 1}), std::vector<double>());
  EXPECT_EQ(solve({-4, 2, 0, 0}), std::vector<double>({2}));
  const double nan = std::numeric_limits<double>::quiet_NaN(), inf = std::numeric_limits<double>::infinity();
  EXPECT_EQ(solve({1, nan, 1}), std::vector<double>());
  EXPECT_EQ(solve({1, 2, inf}), std::vector<double>());
  for (const double scale : {1e-200, 1.0, 1e200}) {  // x^4 - 1: its Sturm sequence drops two degrees at once
    const std::vector<double> roots = solve({-scale, 0, 0, 0, scale});
    ASSERT_EQ(roots.size(), 2u);
    EXPECT_NEAR(roots[0], -1, 1e-12);
    EXPECT_NEAR(roots[1], 1, 1e-12);
  }
  const std::vector<double> triple = solve({-1, 3, -3, 1});  // (x - 1)^3
  ASSERT_EQ(triple.size(), 1u);
  EXPECT_NEAR(triple[0], 1, 1e-4);
  const std::vector<double> wilkinson = solve({40320, -109584, 118124, -67284, 22449, -4536, 546, -36, 1});
  ASSERT_EQ(wilkinson.size(), 8u);
  for (int i = 0; i < 8; ++i) EXPECT_NEAR(wilkinson[i], i + 1, 1e-6);
}

}  // namespace
}  // namespace raysfm
