#include <fmt/format.h>
#include <pybind11/stl.h>

#include <array>
#include <cmath>
#include <memory>

#include "raysfm/camera/camera_check.h"
#include "raysfm/camera/pixel_finder.h"
#include "raysfm/camera_files/camera_convert.h"
#include "raysfm/camera_files/camera_file.h"
#include "raysfm/camera_files/format_fit.h"
#include "support.h"

namespace raysfm::python {
namespace {

// The shape of an array with another last length.
std::vector<py::ssize_t> with_last(const py::array& array, py::ssize_t last) {
  std::vector<py::ssize_t> shape(array.shape(), array.shape() + array.ndim());
  shape.back() = last;
  return shape;
}

py::tuple rays(const Camera& camera, const py::handle& given) {
  const Doubles pixels = doubles_of(given, "pixels", 2);
  py::array_t<double> origins(with_last(pixels, 3)), directions(with_last(pixels, 3));
  const double* in = pixels.data();
  double *o = origins.mutable_data(), *d = directions.mutable_data();
  const py::ssize_t count = pixels.size() / 2;
  {
    const py::gil_scoped_release without_lock;
    for (py::ssize_t i = 0; i < count; ++i) {
      Ray ray;
      if (!camera.ray({in[2 * i], in[2 * i + 1]}, &ray)) {
        ray.origin.setConstant(NAN);
        ray.direction.setConstant(NAN);
      }
      Eigen::Vector3d::Map(o + 3 * i) = ray.origin;
      Eigen::Vector3d::Map(d + 3 * i) = ray.direction;
    }
  }
  return py::make_tuple(origins, directions);
}

py::array_t<double> project(const Camera& camera, const py::handle& given) {
  const Doubles points = doubles_of(given, "points", 3);
  if (!camera.can_project() && camera.width <= 0) {
    raise(bad_input(fmt::format("{}: resolution: missing", camera.name)));
  }
  py::array_t<double> pixels(with_last(points, 2));
  const double* in = points.data();
  double* out = pixels.mutable_data();
  const py::ssize_t count = points.size() / 3;
  const py::gil_scoped_release without_lock;
  const PixelFinder finder(camera);
  for (py::ssize_t i = 0; i < count; ++i) {
    const Eigen::Vector3d point = Eigen::Vector3d::Map(in + 3 * i);
    Eigen::Vector2d pixel;
    if (!point.allFinite() || !finder.find(point, &pixel)) pixel.setConstant(NAN);
    Eigen::Vector2d::Map(out + 2 * i) = pixel;
  }
  return pixels;
}

py::dict parameters(const Camera& camera) {
  py::dict out;
  for (const auto& [name, value] : camera_parameters(camera.model)) out[py::str(std::string(name))] = value;
  return out;
}

py::dict facts(const Camera& camera) {
  if (camera.width <= 0) raise(bad_input(fmt::format("{}: resolution: missing", camera.name)));
  const CameraFacts f = camera_facts(camera);
  using namespace py::literals;
  return py::dict("valid_share"_a = f.valid_share, "fov_horizontal_deg"_a = f.fov_horizontal_deg,
                  "fov_vertical_deg"_a = f.fov_vertical_deg, "fov_diagonal_deg"_a = f.fov_diagonal_deg,
                  "max_angle_deg"_a = f.max_angle_deg,
                  "centre_pixels_per_degree"_a = f.centre_pixels_per_degree, "central"_a = f.central,
                  "mirrored"_a = f.mirrored);
}

std::optional<TableGrid> grid_of(const std::optional<std::array<int, 2>>& grid) {
  if (!grid) return std::nullopt;
  for (const int side : *grid) {
    if (side < 4 || side > 1024) {
      throw py::value_error(fmt::format("grid: {} is not allowed, 4 to 1024 are", side));
    }
  }
  return TableGrid{(*grid)[0], (*grid)[1]};
}

Camera converted(const Camera& given, const std::string& model, bool fit,
                 const std::optional<std::array<int, 2>>& grid) {
  if (given.width <= 0) raise(bad_input(fmt::format("{}: resolution: missing", given.name)));
  Camera camera = given;
  const ModelChoice choice{model, fit || model == "ray-table", grid_of(grid)};
  Result<std::string> report = std::string();
  {
    const py::gil_scoped_release without_lock;
    report = bring_to_format("raysfm", choice, &camera);
  }
  unwrap(std::move(report));
  return camera;
}

py::dict formatted(const Rig& given, const std::string& format, bool fit) {
  Rig rig = given;
  Result<std::vector<CameraFileText>> files = std::vector<CameraFileText>();
  {
    const py::gil_scoped_release without_lock;
    for (Camera& camera : rig.cameras) {
      if (format == "raysfm" || !files) continue;
      const Result<std::string> done = bring_to_format(format, {"", fit}, &camera);
      if (!done) files = done.error();
    }
    if (files) files = format_cameras(rig, format);
  }
  py::dict out;
  for (const CameraFileText& file : unwrap(std::move(files))) out[text(file.name)] = text(file.text);
  return out;
}

void warn(const std::string& note) {
  if (note.empty()) return;
  if (PyErr_WarnEx(PyExc_UserWarning, note.c_str(), 1) != 0) throw py::error_already_set();
}

Rig load(const py::handle& path) {
  std::string note;
  Rig rig = unwrap(read_camera_file(path_of(path), &note));
  warn(note);
  return rig;
}

Rig parse(const std::string& content) {
  std::string note;
  Rig rig = unwrap(parse_camera_file(content, "<text>", &note));
  warn(note);
  return rig;
}

void bind_camera(py::module_& module) {
  py::class_<Camera>(module, "Camera",
                     "A function from pixels to rays, and back where the model can project. The centre of "
                     "the first pixel is (0, 0); x is right, y down, z forward.")
      .def_property_readonly("name", [](const Camera& c) { return text(c.name); })
      .def_property_readonly(
          "model", [](const Camera& c) { return std::string(model_name(c.model)); },
          "Name of the model as in the camera file.")
      .def_property_readonly("parameters", &parameters, "Numbers of the model by name; empty of a table.")
      .def_readonly("width", &Camera::width, "Pixels; 0 where nothing tells it.")
      .def_readonly("height", &Camera::height, "Pixels; 0 where nothing tells it.")
      .def_readonly("stream", &Camera::stream, "The image of an instant that it sees.")
      .def_property(
          "rig_from_cam", [](const Camera& c) { return matrix_of(c.rig_from_cam); },
          [](Camera& c, const py::object& m) { c.rig_from_cam = pose_of(m, "rig_from_cam"); },
          "Its pose in the rig, 4 x 4.")
      .def_property_readonly("can_project", &Camera::can_project,
                             "Whether it projects by formula; else project() searches.")
      .def("ray", &rays, py::arg("pixels"),
           "Rays of pixels, (..., 2): (origins, directions), each (..., 3), in the camera's frame; "
           "directions have unit length. NaN where a pixel sees nothing.")
      .def("project", &project, py::arg("points"),
           "Pixels of points in the camera's frame, (..., 3) to (..., 2). NaN where it does not see them; "
           "pixels may lie outside the image.")
      .def("convert", &converted, py::arg("model"), py::arg("fit") = false, py::arg("grid") = py::none(),
           "The same camera in another model, by formula; with `fit` the nearest one where there is no "
           "formula. A \"ray-table\" is always fitted, with `grid` control points (width, height).")
      .def("facts", &facts, "Field of view and resolution, measured on the rays.")
      .def("__repr__", [](const Camera& c) {
        return text(
            fmt::format("<raysfm.Camera {}: {}, {} x {}>", c.name, model_name(c.model), c.width, c.height));
      });
}

void bind_rig(py::module_& module) {
  py::class_<Rig>(module, "Rig", "Cameras that move together; a single camera is a rig of one.")
      .def(py::init([](std::vector<Camera> cameras) { return Rig{std::move(cameras)}; }), py::arg("cameras"))
      .def_property_readonly(
          "cameras", [](const Rig& rig) { return rig.cameras; }, "List of copies of the cameras.")
      .def("__len__", [](const Rig& rig) { return rig.cameras.size(); })
      .def("__getitem__",
           [](const Rig& rig, py::ssize_t i) {
             const auto count = static_cast<py::ssize_t>(rig.cameras.size());
             if (i < -count || i >= count) throw py::index_error("no such camera");
             return rig.cameras[i < 0 ? i + count : i];
           })
      .def("format", &formatted, py::arg("format") = "raysfm", py::arg("fit") = false,
           "Texts of the files of another tool's format by file name, as `raysfm camera convert` writes "
           "them: raysfm, kalibr, opencv, colmap, basalt, ocamcalib or generic.")
      .def(
          "save",
          [](const Rig& rig, const py::object& path) { unwrap(write_camera_file(rig, path_of(path))); },
          py::arg("path"), "Writes the project's own camera file.")
      .def("__repr__", [](const Rig& rig) {
        return fmt::format("<raysfm.Rig of {} camera{}>", rig.cameras.size(),
                           rig.cameras.size() == 1 ? "" : "s");
      });
}

}  // namespace

void bind_cameras(py::module_& module) {
  bind_camera(module);
  bind_rig(module);
  module.def(
      "load_cameras", &load, py::arg("path"),
      "Cameras of a file of any known format. What the user should know though it is no error comes as "
      "a UserWarning.");
  module.def("parse_cameras", &parse, py::arg("text"), "The same for the content of a camera file.");
}

}  // namespace raysfm::python
