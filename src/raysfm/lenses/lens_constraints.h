#pragma once

#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

#include "raysfm/lenses/lens.h"

namespace raysfm {

// What is known of the lenses (IFBA01 4.3); each on or off.
struct LensConstraints {
  bool zero_skew = true;
  bool unit_aspect = true;             // fx = fy
  bool equal = false;                  // one lens for all images
  bool known_principal_point = false;  // it is `principal_point`
  // Standard deviation of the principal point about `principal_point`, in units of the standard deviation of
  // an observation; 0: nothing is known of it. Ignored when it is known.
  double principal_point_sigma = 0;
  Eigen::Vector2d principal_point = Eigen::Vector2d::Zero();  // pixels
  // Standard deviation of fx about `focal`, in the same units; 0: nothing is known of it.
  double focal_sigma = 0;
  double focal = 0;  // pixels
};

// What is expected of the five numbers of a lens, and the weights of that: squares of one over the standard
// deviations, 0 where nothing is.
struct LensExpectation {
  LensVector mean = LensVector::Zero(), weight = LensVector::Zero();

  bool any() const { return (weight.array() > 0).any(); }
};

// Of every lens, by the constraints.
LensExpectation expected_lens(const LensConstraints& constraints);

// Fewest images with which the constraints make the structure metric, a general motion given: every image
// brings its number of conditions on the eight numbers that tell a metric frame from a projective one (3
// for the plane at infinity, 5 for the absolute conic), and equal but unknown numbers bring one each for
// every image but the first. 0 when no number of images is enough (nothing is known).
int min_images(const LensConstraints& constraints);

// "zero skew, unit aspect ratio" or "none".
std::string describe(const LensConstraints& constraints);

// How much an image says of its lens by the moments of its pixels alone.
struct MomentInformation {
  double weight = 1;  // sum of the weights of its observations
  double spread = 1;  // standard deviation of its pixels along v
  double focal = 1;   // pixels
};

// One condition, linear in the numbers of a lens: coefficients . (k_image - k_reference) = target, where the
// reference is nothing, another image, or the weighted mean of all rows of the same coefficients.
struct ConstraintRow {
  static constexpr int kNothing = -1, kMean = -2;
  int image = 0;
  int reference = kNothing;
  LensVector coefficients = LensVector::Zero();
  double target = 0;
  double weight = 1;  // per pixel of the lens; makes the residual comparable with those of observations
  bool exact = true;  // false: a prior
};

// Rows for all images. `multiple` of the weight of an exact row is relative to what the moments of an image
// say of the number: 1 lets the lenses miss a condition by as much as the noise of their moments, so that
// the sum of squares is close to that of the standard adjustment; a large one imposes it. For multipliers
// the rows must be independent: equal lenses are compared with the first, and what is known is said of the
// first alone.
std::vector<ConstraintRow> constraint_rows(const LensConstraints& constraints,
                                           std::span<const MomentInformation> images, double multiple,
                                           bool independent);

// By row: what coefficients . (k_image - k_reference) is too large.
void violations(std::span<const ConstraintRow> rows, std::span<const Lens> lenses,
                std::vector<double>* result);

// Columns of the free numbers of a lens under the constraints: k = fixed part + basis * parameters, a 5 x p
// matrix, p = 1 ... 5.
Eigen::MatrixXd lens_basis(const LensConstraints& constraints);

// The nearest lens that meets zero skew, unit aspect ratio and the known principal point.
Lens constrained(const Lens& lens, const LensConstraints& constraints);

}  // namespace raysfm
