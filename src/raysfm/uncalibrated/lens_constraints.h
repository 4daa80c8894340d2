#pragma once

#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

#include "raysfm/uncalibrated/lens.h"

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
};

// Fewest images with which the constraints make the structure metric, a general motion given: every image
// brings its number of conditions on the eight numbers that tell a metric frame from a projective one (3
// for the plane at infinity, 5 for the absolute conic), and equal but unknown numbers bring one each for
// every image but the first. 0 when no number of images is enough (nothing is known).
int min_images(const LensConstraints& constraints);

// "zero skew, unit aspect ratio" or "none".
std::string describe(const LensConstraints& constraints);

// One condition, linear in the numbers of one lens, or of the difference between two:
// coefficients . (k_image - k_reference) = target; without a reference, coefficients . k_image = target.
// `weight` makes the residual weight * (left - right) comparable with pixels.
struct ConstraintRow {
  int image = 0;
  int reference = -1;
  LensVector coefficients = LensVector::Zero();
  double target = 0;
  double weight = 1;
  bool exact = true;  // false: a prior

  double violation(std::span<const Lens> lenses) const {
    LensVector k = lenses[image].vector();
    if (reference >= 0) k -= lenses[reference].vector();
    return coefficients.dot(k) - target;
  }
};

// Independent rows for the images listed. Exact rows are divided by `focal` (pixels) and get `weight`.
std::vector<ConstraintRow> constraint_rows(const LensConstraints& constraints, std::span<const int> images,
                                           double focal, double weight);

// Columns of the free numbers of a lens under the constraints: k = fixed part + basis * parameters, a 5 x p
// matrix, p = 1 ... 5.
Eigen::MatrixXd lens_basis(const LensConstraints& constraints);

// The nearest lens that meets zero skew, unit aspect ratio and the known principal point.
Lens constrained(const Lens& lens, const LensConstraints& constraints);

}  // namespace raysfm
