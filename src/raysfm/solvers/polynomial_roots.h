#pragma once

#include <span>

namespace raysfm {

// Of the polynomials that real_roots() takes.
inline constexpr int kMaxRootDegree = 10;

// Real roots within +-1e9 of sum_i coefficients[i] x^i, degree coefficients.size() - 1 <= kMaxRootDegree, by
// a Sturm sequence and bracketed Newton iterations. Each distinct root is written once, in rising order; a
// root of even multiplicity may be missed, being a change of the coefficients' last digits away from not
// existing. `roots` has room for the degree. Returns how many; 0 for a constant and when a coefficient is not
// finite.
// `conditioning`, when not null, gets the smallest relative remainder of the sequence: near 0, the polynomial
// is close to one with a multiple root, and pairs of close roots may be missed or invented.
int real_roots(std::span<const double> coefficients, double* roots, double* conditioning = nullptr);

}  // namespace raysfm
