#include "raysfm/lenses/lens_constraints.h"

#include <cmath>

namespace raysfm {
namespace {

constexpr int kFx = 0, kFy = 1, kCx = 2, kCy = 3, kSkew = 4;

int known_numbers(const LensConstraints& c) {
  const bool principal_point = c.known_principal_point || c.principal_point_sigma > 0;
  return int(c.zero_skew) + int(c.unit_aspect) + 2 * int(principal_point) + int(c.focal_sigma > 0);
}

class RowWriter {
 public:
  RowWriter(std::span<const MomentInformation> images, double multiple)
      : images_(images), multiple_(multiple) {}

  // The condition that `coefficients` . k is `target`; at the scale of a focal length or of a principal
  // point.
  ConstraintRow& add(int image, const LensVector& coefficients, double target) {
    const MomentInformation& known = images_[image];
    const bool principal_point = coefficients[kCx] != 0 || coefficients[kCy] != 0;
    ConstraintRow& row = rows.emplace_back();
    row.image = image;
    row.coefficients = coefficients;
    row.target = target;
    row.weight = multiple_ * std::sqrt(known.weight) * (principal_point ? 1 : known.spread / known.focal);
    return row;
  }

  size_t images() const { return images_.size(); }

  std::vector<ConstraintRow> rows;

 private:
  std::span<const MomentInformation> images_;
  double multiple_;
};

// Makes a row a prior. One lens has one.
void make_prior(const LensConstraints& c, double sigma, bool shared, size_t images, ConstraintRow* row) {
  row->weight = 1 / sigma;
  row->exact = false;
  if (c.equal && shared) row->weight /= std::sqrt(static_cast<double>(images));
}

void add_known(const LensConstraints& c, int image, bool shared_prior, RowWriter* writer) {
  if (c.zero_skew) writer->add(image, LensVector::Unit(kSkew), 0);
  if (c.unit_aspect) writer->add(image, LensVector::Unit(kFx) - LensVector::Unit(kFy), 0);
  for (int axis = 0; axis < 2; ++axis) {
    if (!c.known_principal_point && !(c.principal_point_sigma > 0)) continue;
    ConstraintRow& row = writer->add(image, LensVector::Unit(kCx + axis), c.principal_point[axis]);
    if (c.known_principal_point) continue;
    make_prior(c, c.principal_point_sigma, shared_prior, writer->images(), &row);
  }
  if (!(c.focal_sigma > 0)) return;
  make_prior(c, c.focal_sigma, shared_prior, writer->images(),
             &writer->add(image, LensVector::Unit(kFx), c.focal));
}

}  // namespace

LensExpectation expected_lens(const LensConstraints& c) {
  LensExpectation expected;
  expected.mean << c.focal, 0, c.principal_point, 0;
  if (c.focal_sigma > 0) expected.weight[kFx] = 1 / (c.focal_sigma * c.focal_sigma);
  if (c.principal_point_sigma > 0 && !c.known_principal_point) {
    expected.weight.segment<2>(kCx).setConstant(1 / (c.principal_point_sigma * c.principal_point_sigma));
  }
  return expected;
}

int min_images(const LensConstraints& constraints) {
  const int known = known_numbers(constraints), fixed = constraints.equal ? 5 - known : 0;
  const int each = known + fixed;
  return each == 0 ? 0 : (8 + fixed + each - 1) / each;
}

std::string describe(const LensConstraints& c) {
  std::string text;
  const auto append = [&text](bool on, const char* name) {
    if (on) text += (text.empty() ? "" : ", ") + std::string(name);
  };
  append(c.zero_skew, "zero skew");
  append(c.unit_aspect, "unit aspect ratio");
  append(c.equal, "equal lenses");
  append(c.known_principal_point, "known principal point");
  append(!c.known_principal_point && c.principal_point_sigma > 0, "principal point near its expected place");
  append(c.focal_sigma > 0, "focal length near its expected value");
  return text.empty() ? "none" : text;
}

std::vector<ConstraintRow> constraint_rows(const LensConstraints& constraints,
                                           std::span<const MomentInformation> images, double multiple,
                                           bool independent) {
  RowWriter writer(images, multiple);
  for (int j = 0; j < static_cast<int>(images.size()); ++j) {
    const bool by_the_first = constraints.equal && j > 0;
    if (!(by_the_first && independent)) add_known(constraints, j, !independent, &writer);
    for (int number = 0; number < 5 && constraints.equal; ++number) {
      if (independent && j == 0) continue;
      writer.add(j, LensVector::Unit(number), 0).reference = independent ? 0 : ConstraintRow::kMean;
    }
  }
  return std::move(writer.rows);
}

void violations(std::span<const ConstraintRow> rows, std::span<const Lens> lenses,
                std::vector<double>* result) {
  LensVector mean = LensVector::Zero(), sum = LensVector::Zero();
  for (const ConstraintRow& row : rows) {
    if (row.reference != ConstraintRow::kMean) continue;
    const LensVector weight = row.weight * row.weight * row.coefficients;
    mean += weight.cwiseProduct(lenses[row.image].vector());
    sum += weight;
  }
  mean = (sum.array() > 0).select(mean.cwiseQuotient(sum.cwiseMax(1e-300)), mean);
  result->clear();
  for (const ConstraintRow& row : rows) {
    LensVector k = lenses[row.image].vector();
    if (row.reference == ConstraintRow::kMean) k -= mean;
    if (row.reference >= 0) k -= lenses[row.reference].vector();
    result->push_back(row.coefficients.dot(k) - row.target);
  }
}

Eigen::MatrixXd lens_basis(const LensConstraints& c) {
  std::vector<LensVector> columns;
  const auto unit = [](int number) -> LensVector { return LensVector::Unit(number); };
  if (c.unit_aspect) {
    columns.push_back(unit(kFx) + unit(kFy));
  } else {
    columns.push_back(unit(kFx));
    columns.push_back(unit(kFy));
  }
  if (!c.known_principal_point) {
    columns.push_back(unit(kCx));
    columns.push_back(unit(kCy));
  }
  if (!c.zero_skew) columns.push_back(unit(kSkew));
  Eigen::MatrixXd basis(5, columns.size());
  for (size_t i = 0; i < columns.size(); ++i) basis.col(i) = columns[i];
  return basis;
}

Lens constrained(const Lens& lens, const LensConstraints& c) {
  Lens result = lens;
  if (c.zero_skew) result.skew = 0;
  if (c.unit_aspect) result.fx = result.fy = 0.5 * (lens.fx + lens.fy);
  if (c.known_principal_point) {
    result.cx = c.principal_point.x();
    result.cy = c.principal_point.y();
  }
  return result;
}

}  // namespace raysfm
