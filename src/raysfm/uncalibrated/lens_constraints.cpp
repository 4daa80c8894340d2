#include "raysfm/uncalibrated/lens_constraints.h"

namespace raysfm {
namespace {

constexpr int kFx = 0, kFy = 1, kCx = 2, kCy = 3, kSkew = 4;

int known_numbers(const LensConstraints& c) {
  const bool principal_point = c.known_principal_point || c.principal_point_sigma > 0;
  return int(c.zero_skew) + int(c.unit_aspect) + 2 * int(principal_point);
}

class RowWriter {
 public:
  RowWriter(double focal, double weight) : focal_(focal), weight_(weight) {}

  ConstraintRow& add(int image) {
    ConstraintRow& row = rows.emplace_back();
    row.image = image;
    row.weight = weight_ / focal_;
    return row;
  }
  void add_single(int image, int number, double target) {
    ConstraintRow& row = add(image);
    row.coefficients[number] = 1;
    row.target = target;
  }

  std::vector<ConstraintRow> rows;

 private:
  double focal_, weight_;
};

void add_known(const LensConstraints& c, int image, RowWriter* writer) {
  if (c.zero_skew) writer->add_single(image, kSkew, 0);
  if (c.unit_aspect) {
    ConstraintRow& row = writer->add(image);
    row.coefficients[kFx] = 1;
    row.coefficients[kFy] = -1;
  }
  if (c.known_principal_point) {
    writer->add_single(image, kCx, c.principal_point.x());
    writer->add_single(image, kCy, c.principal_point.y());
  } else if (c.principal_point_sigma > 0) {
    for (int axis = 0; axis < 2; ++axis) {
      writer->add_single(image, kCx + axis, c.principal_point[axis]);
      writer->rows.back().weight = 1 / c.principal_point_sigma;
      writer->rows.back().exact = false;
    }
  }
}

}  // namespace

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
  return text.empty() ? "none" : text;
}

std::vector<ConstraintRow> constraint_rows(const LensConstraints& constraints, std::span<const int> images,
                                           double focal, double weight) {
  RowWriter writer(focal, weight);
  for (const int image : images) {
    const bool first = image == images.front();
    if (first || !constraints.equal) {
      add_known(constraints, image, &writer);
      continue;
    }
    for (int number = 0; number < 5; ++number) {
      writer.add_single(image, number, 0);
      writer.rows.back().reference = images.front();
    }
  }
  return std::move(writer.rows);
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
