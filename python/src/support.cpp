#include "support.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <type_traits>
#include <variant>

namespace raysfm::python {
namespace {

PyObject* error_type = nullptr;
PyObject* bad_input_type = nullptr;
PyObject* no_reconstruction_type = nullptr;
PyObject* internal_type = nullptr;
PyObject* stop_type = nullptr;

PyObject* new_type(py::module_& module, const char* name, const char* doc, const py::tuple& bases) {
  PyObject* type =
      PyErr_NewExceptionWithDoc(fmt::format("raysfm.{}", name).c_str(), doc, bases.ptr(), nullptr);
  if (!type) throw py::error_already_set();
  module.add_object(name, type);
  return type;
}

PyObject* type_of(ErrorKind kind) {
  if (kind == ErrorKind::kBadInput) return bad_input_type;
  return kind == ErrorKind::kNoReconstruction ? no_reconstruction_type : internal_type;
}

[[noreturn]] void refuse_type(const SettingField& field, const py::handle& value, const char* allowed) {
  throw py::type_error(
      fmt::format("{}: {} is not allowed, {} is", field.name, py::repr(value).cast<std::string>(), allowed));
}

// bool passes for int in Python, which hides mistakes.
bool is_bool(const py::handle& value) {
  return PyBool_Check(value.ptr()) != 0 || std::string_view(Py_TYPE(value.ptr())->tp_name) == "numpy.bool_";
}

template <typename Integer>
void set_integer(const SettingField& field, const py::handle& value, Integer* target) {
  if (is_bool(value) || PyIndex_Check(value.ptr()) == 0) refuse_type(field, value, "a whole number");
  const auto number = py::reinterpret_steal<py::object>(PyNumber_Index(value.ptr()));
  if (!number) throw py::error_already_set();
  try {
    *target = number.cast<Integer>();
  } catch (const py::cast_error&) {
    throw py::value_error(
        fmt::format("{}: {} is not allowed, {} to {} are", field.name, py::str(number).cast<std::string>(),
                    std::numeric_limits<Integer>::min(), std::numeric_limits<Integer>::max()));
  }
}

void set_value(const SettingField& field, const py::handle& value, bool* target) {
  if (!is_bool(value)) refuse_type(field, value, "True or False");
  *target = py::bool_(py::reinterpret_borrow<py::object>(value));
}
void set_value(const SettingField& field, const py::handle& value, int* target) {
  set_integer(field, value, target);
}
void set_value(const SettingField& field, const py::handle& value, uint64_t* target) {
  set_integer(field, value, target);
}
void set_value(const SettingField& field, const py::handle& value, double* target) {
  const double number = is_bool(value) ? -1 : PyFloat_AsDouble(value.ptr());
  if (is_bool(value) || PyErr_Occurred()) {
    PyErr_Clear();
    refuse_type(field, value, "a number");
  }
  *target = number;
}
void set_value(const SettingField& field, const py::handle& value, std::string* target) {
  if (py::isinstance<py::str>(value) || py::isinstance<py::bytes>(value) ||
      py::hasattr(value, "__fspath__")) {
    *target = path_of(value);
    return;
  }
  refuse_type(field, value, "a text");
}

}  // namespace

void bind_errors(py::module_& module) {
  const auto of = [](PyObject* type) { return py::reinterpret_borrow<py::object>(type); };
  error_type = new_type(module, "Error", "What this package raises; its text is that of the program.",
                        py::make_tuple(of(PyExc_Exception)));
  bad_input_type = new_type(module, "BadInputError", "A file, field or value that can be corrected.",
                            py::make_tuple(of(error_type), of(PyExc_ValueError)));
  no_reconstruction_type =
      new_type(module, "NoReconstructionError",
               "The images do not allow an answer. `result`, where there is one, has what is known.",
               py::make_tuple(of(error_type), of(PyExc_RuntimeError)));
  internal_type = new_type(module, "InternalError", "A fault of the library.",
                           py::make_tuple(of(error_type), of(PyExc_RuntimeError)));
  stop_type =
      new_type(module, "Stop", "Raised by a function that hears of a run: it ends early with what there is.",
               py::make_tuple(of(PyExc_Exception)));
}

bool is_stop(const py::error_already_set& error) {
  return error.matches(stop_type);
}

void raise(const Error& error) {
  PyErr_SetObject(type_of(error.kind), text(error.message).ptr());
  throw py::error_already_set();
}

void raise_with_result(const Error& error, const py::object& result) {
  const py::object exception = py::reinterpret_borrow<py::object>(type_of(error.kind))(text(error.message));
  exception.attr("result") = result;
  PyErr_SetObject(type_of(error.kind), exception.ptr());
  throw py::error_already_set();
}

py::str text(const std::string& bytes) {
  PyObject* decoded =
      PyUnicode_DecodeUTF8(bytes.data(), static_cast<Py_ssize_t>(bytes.size()), "surrogateescape");
  if (!decoded) throw py::error_already_set();
  return py::reinterpret_steal<py::str>(decoded);
}

std::string path_of(const py::handle& path) {
  PyObject* bytes = nullptr;
  if (PyUnicode_FSConverter(path.ptr(), &bytes) == 0) throw py::error_already_set();
  return py::reinterpret_steal<py::bytes>(bytes);
}

std::vector<std::string> paths_of(const py::handle& paths, const char* argument) {
  if (py::isinstance<py::str>(paths) || py::isinstance<py::bytes>(paths) ||
      py::hasattr(paths, "__fspath__")) {
    return {path_of(paths)};
  }
  if (!py::isinstance<py::list>(paths) && !py::isinstance<py::tuple>(paths)) {
    throw py::type_error(fmt::format("{}: {} is not allowed, a path or a list of them is", argument,
                                     std::string_view(Py_TYPE(paths.ptr())->tp_name)));
  }
  std::vector<std::string> out;
  for (const py::handle path : paths) out.push_back(path_of(path));
  return out;
}

std::string shape_text(const py::array& array) {
  std::string out = "(";
  for (py::ssize_t i = 0; i < array.ndim(); ++i) {
    out += fmt::format("{}{}", i > 0 ? ", " : "", array.shape(i));
  }
  return out + (array.ndim() == 1 ? ",)" : ")");
}

Doubles doubles_of(const py::handle& values, const char* argument, py::ssize_t last) {
  const py::array given = py::array::ensure(values);
  if (!given) PyErr_Clear();
  const char kind = given ? given.dtype().kind() : 'O';
  if (kind != 'f' && kind != 'i' && kind != 'u') {
    throw py::type_error(fmt::format("{}: {} is not allowed, an array of real numbers is", argument,
                                     given ? "dtype " + py::str(given.dtype()).cast<std::string>()
                                           : std::string(Py_TYPE(values.ptr())->tp_name)));
  }
  if (given.ndim() == 0 || given.shape(given.ndim() - 1) != last) {
    throw py::value_error(
        fmt::format("{}: shape {} is not allowed, (..., {}) is", argument, shape_text(given), last));
  }
  return py::array_t<double, py::array::c_style | py::array::forcecast>(given);
}

py::array_t<double> matrix_of(const Rigid3& pose) {
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
  matrix.topLeftCorner<3, 3>() = pose.rotation.toRotationMatrix();
  matrix.topRightCorner<3, 1>() = pose.translation;
  return array_of(matrix);
}

Rigid3 pose_of(const py::handle& values, const char* argument) {
  const Doubles matrix = doubles_of(values, argument, 4);
  if (matrix.ndim() != 2 || matrix.shape(0) != 4) {
    throw py::value_error(
        fmt::format("{}: shape {} is not allowed, (4, 4) is", argument, shape_text(matrix)));
  }
  const Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> m(matrix.data());
  const Eigen::Matrix3d rotation = m.topLeftCorner<3, 3>();
  const bool rigid = (rotation * rotation.transpose() - Eigen::Matrix3d::Identity()).norm() < 1e-6 &&
                     rotation.determinant() > 0 && m.row(3).isApprox(Eigen::RowVector4d(0, 0, 0, 1)) &&
                     m.allFinite();
  if (!rigid) throw py::value_error(fmt::format("{}: no rigid motion", argument));
  return {Eigen::Quaterniond(rotation).normalized(), m.topRightCorner<3, 1>()};
}

void set_settings(const char* function, const py::kwargs& given, const std::vector<SettingField>& fields) {
  for (const auto& entry : given) {
    const std::string argument = py::str(entry.first);
    const py::handle value = entry.second;
    std::string name = argument;
    std::ranges::replace(name, '_', '-');
    const auto field = std::ranges::find(fields, name, &SettingField::name);
    if (field == fields.end() || argument.find('-') != std::string::npos) {
      throw py::type_error(fmt::format("{}() got an unexpected keyword argument '{}'", function, argument));
    }
    if (value.is_none()) continue;
    std::visit([&](auto* target) { set_value(*field, value, target); }, field->value);
  }
  unwrap(check_allowed(fields));
}

}  // namespace raysfm::python
