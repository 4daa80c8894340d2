#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/files/config_tree.h"
#include "raysfm/geometry/pose.h"

namespace raysfm {

// The first thing found wrong in a file. Readers go on with harmless values after it and the caller asks
// once, at the end, which keeps the reading of a format a plain list of its fields.
class ConfigProblem {
 public:
  explicit ConfigProblem(std::string file) : file_(std::move(file)) {}

  // "file: field: value, allowed". Only the first call counts.
  void report(const std::string& field, const std::string& value, const std::string& allowed);
  bool any() const { return !message_.empty(); }
  Error error() const { return bad_input(message_); }

 private:
  std::string file_;
  std::string message_;
};

// A value of a document together with its name, e.g. "cameras[1].resolution". A field may be missing; reading
// a missing field, or one of the wrong type, reports the problem and returns zeros.
class ConfigField {
 public:
  ConfigField(const ConfigNode* node, std::string name, ConfigProblem* problem)
      : node_(node), name_(std::move(name)), problem_(problem) {}

  bool exists() const { return node_ && node_->kind != ConfigNode::Kind::kNull; }
  bool is_map() const { return exists() && node_->kind == ConfigNode::Kind::kMap; }
  bool is_list() const { return exists() && node_->kind == ConfigNode::Kind::kList; }
  const std::string& name() const { return name_; }
  const std::vector<std::string>& keys() const;  // of a map, else empty

  ConfigField at(std::string_view key) const;  // of a map
  ConfigField any_of(
      std::initializer_list<std::string_view> keys) const;  // the first that exists, else the first
  std::vector<ConfigField> list() const;                    // of a list
  std::string text() const;
  double number() const;                 // finite
  int integer(int low, int high) const;  // in [low, high]
  // Finite numbers: a list, nested or not, a run of words, or the `data` of a matrix.
  std::vector<double> numbers() const;
  std::vector<double> numbers(size_t count) const;  // exactly so many
  std::vector<double> numbers_or_holes() const;     // a list; ~ (null) becomes NaN
  Rigid3 rigid_matrix() const;                      // 4 x 4 or 3 x 4 by rows; rotation within 1e-3

  void report(const std::string& allowed) const;  // this field's value is not allowed
  void allow_only(const std::vector<std::string_view>& keys) const;
  ConfigProblem& problem() const { return *problem_; }

 private:
  std::string value() const;
  void append_numbers(const ConfigNode& node, bool holes, std::vector<double>* out) const;

  const ConfigNode* node_;
  std::string name_;
  ConfigProblem* problem_;
};

// The rotation nearest to `matrix`, or nullopt where an entry is more than 1e-3 away from it.
std::optional<Eigen::Quaterniond> nearest_rotation(const Eigen::Matrix3d& matrix);

}  // namespace raysfm
