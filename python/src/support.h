#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <Eigen/Core>
#include <string>
#include <utility>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/geometry/pose.h"
#include "raysfm/settings/config.h"

// What the parts of the Python module share: errors, texts and arrays on their way in and out.
namespace raysfm::python {

namespace py = pybind11;

// Adds the exceptions Error, BadInputError, NoReconstructionError, InternalError and Stop to the module.
void bind_errors(py::module_& module);
bool is_stop(const py::error_already_set& error);
// Raises the exception of the error's kind, with its text.
[[noreturn]] void raise(const Error& error);
// The same with an attribute `result`.
[[noreturn]] void raise_with_result(const Error& error, const py::object& result);

template <typename T>
T unwrap(Result<T> result) {
  if (!result) raise(result.error());
  return *std::move(result);
}
inline void unwrap(const Result<void>& result) {
  if (!result) raise(result.error());
}

// File names are bytes: those that are no UTF-8 come and go as os.fsdecode() has them.
py::str text(const std::string& bytes);
// Of str, bytes or os.PathLike; else TypeError, as everywhere in Python.
std::string path_of(const py::handle& path);
// Of one path or a sequence of them. TypeError names the argument.
std::vector<std::string> paths_of(const py::handle& paths, const char* argument);

// Real numbers as contiguous doubles of any shape that ends with `last`. Errors name the argument: TypeError
// for what holds no real numbers, ValueError for another shape.
using Doubles = py::array_t<double, py::array::c_style>;
Doubles doubles_of(const py::handle& values, const char* argument, py::ssize_t last);
// "(3, 4)"
std::string shape_text(const py::array& array);

// 4 x 4, and back; ValueError, which names the argument, where the upper left part is no rotation within
// 1e-6.
py::array_t<double> matrix_of(const Rigid3& pose);
Rigid3 pose_of(const py::handle& matrix, const char* argument);

template <typename Derived>
py::array_t<double> array_of(const Eigen::DenseBase<Derived>& values) {
  std::vector<py::ssize_t> shape = {values.rows()};
  if (Derived::ColsAtCompileTime != 1) shape.push_back(values.cols());
  py::array_t<double> out(shape);
  double* data = out.mutable_data();
  for (Eigen::Index r = 0; r < values.rows(); ++r) {
    for (Eigen::Index c = 0; c < values.cols(); ++c) *data++ = values(r, c);
  }
  return out;
}

// Sets the fields that keyword arguments name, "-" in a field's name written as "_"; None leaves the default.
// TypeError for unknown names and values of another type, ValueError for numbers out of range, BadInputError
// for texts that are not allowed.
void set_settings(const char* function, const py::kwargs& given, const std::vector<SettingField>& fields);

// The parts of the module.
void bind_cameras(py::module_& module);
void bind_reconstruction(py::module_& module);
void bind_frames(py::module_& module);
void bind_tracker(py::module_& module);
void bind_runs(py::module_& module);
void bind_evaluation(py::module_& module);

}  // namespace raysfm::python
