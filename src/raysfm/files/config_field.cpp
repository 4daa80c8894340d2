#include "raysfm/files/config_field.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>

#include "raysfm/files/text_file.h"

namespace raysfm {

void ConfigProblem::report(const std::string& field, const std::string& value, const std::string& allowed) {
  if (any()) return;
  message_ =
      fmt::format("{}: {}: {}; allowed: {}", file_, field.empty() ? "document" : field, value, allowed);
}

const std::vector<std::string>& ConfigField::keys() const {
  static const std::vector<std::string> none;
  return is_map() ? node_->keys : none;
}

std::string ConfigField::value() const {
  if (!exists()) return "missing";
  switch (node_->kind) {
    case ConfigNode::Kind::kScalar:
      return "'" + shown(node_->text) + "'";
    case ConfigNode::Kind::kList:
      return fmt::format("a list of {}", node_->items.size());
    case ConfigNode::Kind::kMap:
      return "a map";
    case ConfigNode::Kind::kNull:
      break;
  }
  return "missing";
}

void ConfigField::report(const std::string& allowed) const {
  problem_->report(name_, value(), allowed);
}

ConfigField ConfigField::at(std::string_view key) const {
  std::string name = name_.empty() ? std::string(key) : fmt::format("{}.{}", name_, key);
  return {is_map() ? node_->find(key) : nullptr, std::move(name), problem_};
}

ConfigField ConfigField::any_of(std::initializer_list<std::string_view> keys) const {
  for (std::string_view key : keys) {
    if (at(key).exists()) return at(key);
  }
  return at(*keys.begin());
}

std::vector<ConfigField> ConfigField::list() const {
  std::vector<ConfigField> fields;
  if (!is_list()) {
    report("a list");
    return fields;
  }
  for (size_t i = 0; i < node_->items.size(); ++i) {
    fields.emplace_back(&node_->items[i], fmt::format("{}[{}]", name_, i), problem_);
  }
  return fields;
}

std::string ConfigField::text() const {
  if (!exists() || node_->kind != ConfigNode::Kind::kScalar) {
    report("a text");
    return {};
  }
  return node_->text;
}

double ConfigField::number() const {
  const bool scalar = exists() && node_->kind == ConfigNode::Kind::kScalar;
  const std::optional<double> value = scalar ? parse_number(node_->text) : std::nullopt;
  if (!value || !std::isfinite(*value)) {
    report("a finite number");
    return 0;
  }
  return *value;
}

int ConfigField::integer(int low, int high) const {
  const bool scalar = exists() && node_->kind == ConfigNode::Kind::kScalar;
  const std::optional<int64_t> value = scalar ? parse_integer(node_->text) : std::nullopt;
  if (!value || *value < low || *value > high) {
    report(fmt::format("an integer from {} to {}", low, high));
    return low;
  }
  return static_cast<int>(*value);
}

void ConfigField::append_numbers(const ConfigNode& node, bool holes, std::vector<double>* out) const {
  if (holes && node.kind == ConfigNode::Kind::kNull) {
    out->push_back(std::numeric_limits<double>::quiet_NaN());
  } else if (node.kind == ConfigNode::Kind::kScalar) {
    for (std::string_view word : split_words(node.text)) {
      const std::optional<double> value = parse_number(word);
      if (!value || !std::isfinite(*value)) {
        problem_->report(name_, "'" + shown(word) + "'", "finite numbers");
        return;
      }
      out->push_back(*value);
    }
  } else if (node.kind == ConfigNode::Kind::kMap && node.find("data")) {
    append_numbers(*node.find("data"), holes, out);
  } else if (node.kind == ConfigNode::Kind::kList) {
    for (const ConfigNode& item : node.items) append_numbers(item, holes, out);
  } else {
    report("finite numbers");
  }
}

std::vector<double> ConfigField::numbers() const {
  std::vector<double> values;
  if (!exists()) {
    report("a list of finite numbers");
    return values;
  }
  append_numbers(*node_, false, &values);
  return values;
}

std::vector<double> ConfigField::numbers_or_holes() const {
  std::vector<double> values;
  if (!is_list()) {
    report("a list of finite numbers and ~");
    return values;
  }
  append_numbers(*node_, true, &values);
  return values;
}

std::vector<double> ConfigField::numbers(size_t count) const {
  std::vector<double> values = numbers();
  if (values.size() != count) {
    problem_->report(name_, exists() ? fmt::format("{} numbers", values.size()) : "missing",
                     fmt::format("{} finite numbers", count));
    values.assign(count, 0);
  }
  return values;
}

Rigid3 ConfigField::rigid_matrix() const {
  std::vector<double> values = numbers();
  if (values.size() != 12 && values.size() != 16) {
    problem_->report(name_, exists() ? fmt::format("{} numbers", values.size()) : "missing",
                     "a 4 x 4 matrix by rows");
    return {};
  }
  const Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>> matrix(values.data());
  const std::optional<Eigen::Quaterniond> rotation = nearest_rotation(matrix.leftCols<3>());
  const bool affine =
      values.size() == 12 || (values[12] == 0 && values[13] == 0 && values[14] == 0 && values[15] == 1);
  if (!rotation || !affine) {
    problem_->report(name_, "no rigid motion", "a rotation matrix and a translation, last row 0 0 0 1");
    return {};
  }
  return {*rotation, matrix.col(3)};
}

void ConfigField::allow_only(const std::vector<std::string_view>& keys) const {
  if (!is_map()) return report("a map");
  for (const std::string& key : node_->keys) {
    if (std::find(keys.begin(), keys.end(), key) != keys.end()) continue;
    const std::string name = name_.empty() ? shown(key) : fmt::format("{}.{}", name_, shown(key));
    problem_->report(name, "unknown field", fmt::format("{}", fmt::join(keys, ", ")));
  }
}

std::optional<Eigen::Quaterniond> nearest_rotation(const Eigen::Matrix3d& matrix) {
  constexpr double kTolerance = 1e-3;
  if (!matrix.allFinite() || matrix.cwiseAbs().maxCoeff() > 2) return std::nullopt;
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(matrix, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::Matrix3d rotation = svd.matrixU() * svd.matrixV().transpose();
  if (!(rotation.determinant() > 0) || !((rotation - matrix).cwiseAbs().maxCoeff() <= kTolerance)) {
    return std::nullopt;
  }
  return Eigen::Quaterniond(rotation).normalized();
}

}  // namespace raysfm
