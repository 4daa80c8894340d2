#include "raysfm/frames/frame_set.h"

#include <pybind11/stl.h>

#include <memory>

#include "raysfm/frames/frame_source.h"
#include "support.h"

namespace raysfm::python {
namespace {

// An array that looks at an image and keeps it.
py::array_t<uint8_t> array_of_image(Image<uint8_t> image, int channels) {
  auto* owned = new Image<uint8_t>(std::move(image));
  const py::capsule keep(owned, [](void* p) { delete static_cast<Image<uint8_t>*>(p); });
  const py::ssize_t stride = owned->view().stride, height = owned->height();
  if (channels == 1)
    return {{height, py::ssize_t{owned->width()}}, {stride, py::ssize_t{1}}, owned->row(0), keep};
  const py::ssize_t width = owned->width() / channels;
  return {
      {height, width, py::ssize_t{3}}, {stride, py::ssize_t{channels}, py::ssize_t{1}}, owned->row(0), keep};
}

// Grey levels, or red, green and blue.
py::object image_of(InputFrame frame) {
  if (!frame.defect.empty()) return py::none();
  if (frame.colors.empty()) return array_of_image(std::move(frame.gray), 1);
  if (!frame.colors.rgb.empty()) {
    return array_of_image(std::move(frame.colors.rgb), frame.colors.values_per_pixel);
  }
  Image<uint8_t> rgb(3 * frame.gray.width(), frame.gray.height());
  {
    const py::gil_scoped_release without_lock;
    for (int y = 0; y < frame.gray.height(); ++y) {
      uint8_t* out = rgb.row(y);
      for (int x = 0; x < frame.gray.width(); ++x) {
        const auto color = frame.colors.at(x, y, frame.gray.row(y)[x]);
        out = std::copy(color.begin(), color.end(), out);
      }
    }
  }
  return array_of_image(std::move(rgb), 3);
}

// What the inputs of the command line hold, read frame by frame.
class FrameReader {
 public:
  FrameReader(const py::object& inputs, double fps, bool mono)
      : input_(opened(paths_of(inputs, "inputs"), {.fps = fps, .mono = mono})), reader_(input_.streams) {}

  py::tuple next() {
    Result<std::vector<InputFrame>> frames = std::vector<InputFrame>();
    {
      const py::gil_scoped_release without_lock;
      frames = reader_.next();
    }
    std::vector<InputFrame> read = unwrap(std::move(frames));
    if (read.empty()) throw py::stop_iteration();
    const double timestamp = read[0].timestamp;
    const py::str name = text(read[0].name);
    py::list images;
    for (InputFrame& frame : read) images.append(image_of(std::move(frame)));
    return py::make_tuple(images, timestamp, name);
  }

  const Input& input() const { return input_; }

 private:
  static Input opened(const std::vector<std::string>& inputs, const InputOptions& options) {
    if (inputs.empty()) raise(bad_input("INPUT is missing"));
    unwrap(check_fps(options.fps));
    return unwrap(open_input(inputs, options));
  }

  Input input_;
  FrameSetReader reader_;
};

py::object truth_of(const FrameReader& reader) {
  const auto& truth = reader.input().truth;
  return truth ? py::object(text(truth->string())) : py::none();
}

}  // namespace

void bind_frames(py::module_& module) {
  py::class_<FrameReader>(
      module, "Frames",
      "The frames of a video, images or a sequence, as `raysfm track` reads them: an iterator of "
      "(images, timestamp, name). `images` has one array of each stream, (height, width) or "
      "(height, width, 3) red, green, blue, uint8; None where it is damaged.")
      .def(py::init<const py::object&, double, bool>(), py::arg("inputs"), py::kw_only(),
           py::arg("fps") = 0.0, py::arg("mono") = false)
      .def_property_readonly(
          "rig", [](const FrameReader& reader) { return reader.input().calibration; },
          "The cameras found beside the images, None where there are none.")
      .def_property_readonly("truth", &truth_of, "Path of the known trajectory beside the images, or None.")
      .def("__iter__", [](const py::object& self) { return self; })
      .def("__next__", &FrameReader::next);
}

}  // namespace raysfm::python
