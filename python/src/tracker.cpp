#include "raysfm/odometry/tracker.h"

#include <fmt/format.h>
#include <pybind11/stl.h>

#include <memory>
#include <mutex>
#include <thread>

#include "long_call.h"
#include "raysfm/api/track.h"
#include "raysfm/core/memory.h"
#include "raysfm/core/thread_pool.h"
#include "raysfm/core/timer.h"
#include "raysfm/frames/frame_source.h"
#include "raysfm/frames/image_file.h"
#include "raysfm/streams/view_stream.h"
#include "run.h"
#include "support.h"

namespace raysfm::python {
namespace {

constexpr py::ssize_t kMaxBytes = (py::ssize_t{1} << 31) - 1;  // of an image

struct ChannelOrder {
  const char* name;
  PixelFormat three, four;
};
constexpr ChannelOrder kRgbOrder = {"rgb", PixelFormat::kRgb, PixelFormat::kRgba};
constexpr ChannelOrder kBgrOrder = {"bgr", PixelFormat::kBgr, PixelFormat::kBgra};

ChannelOrder order_of(const std::string& name) {
  if (name == kRgbOrder.name) return kRgbOrder;
  if (name == kBgrOrder.name) return kBgrOrder;
  throw py::value_error(fmt::format("channels: '{}' is not allowed, rgb or bgr is", name));
}

// A view of the pixels of an array, of which it says what is wrong under the name of `argument`. Rows may lie
// anywhere; the pixels of a row are side by side, the colours of a pixel too, forwards or (of three)
// backwards.
PixelView view_of(const py::handle& value, const std::string& argument, ChannelOrder order) {
  if (!py::isinstance<py::array>(value)) {
    throw py::type_error(fmt::format("{}: {} is not allowed, a numpy array of uint8 is", argument,
                                     std::string_view(Py_TYPE(value.ptr())->tp_name)));
  }
  const auto array = py::reinterpret_borrow<py::array>(value);
  if (!array.dtype().is(py::dtype::of<uint8_t>())) {
    throw py::type_error(fmt::format("{}: dtype {} is not allowed, uint8 is", argument,
                                     py::str(array.dtype()).cast<std::string>()));
  }
  const py::ssize_t channels = array.ndim() == 3 ? array.shape(2) : 1;
  const bool fits = (array.ndim() == 2 || array.ndim() == 3) && array.size() > 0 &&
                    (channels == 1 || channels == 3 || channels == 4) && array.size() <= kMaxBytes;
  if (!fits) {
    throw py::value_error(
        fmt::format("{}: shape {} is not allowed; (height, width), (height, width, 3) and "
                    "(height, width, 4) are, of less than 2 GiB",
                    argument, shape_text(array)));
  }
  const py::ssize_t width = array.shape(1);
  const bool backwards = channels == 3 && array.strides(2) == -1;
  const bool side_by_side =
      (width == 1 || array.strides(1) == channels) && (channels == 1 || backwards || array.strides(2) == 1);
  if (!side_by_side) {
    throw py::value_error(
        fmt::format("{}: the pixels of a row are not side by side in memory; "
                    "numpy.ascontiguousarray() makes them so",
                    argument));
  }
  PixelView view{static_cast<const uint8_t*>(array.data()), static_cast<int>(width),
                 static_cast<int>(array.shape(0)), array.strides(0)};
  if (backwards) {
    view.data -= 2;
    order = order.three == PixelFormat::kRgb ? kBgrOrder : kRgbOrder;
  }
  if (channels > 1) view.format = channels == 3 ? order.three : order.four;
  return view;
}

// The images of one instant: one array, or one of each stream; None did not arrive.
std::vector<PixelView> views_of(const py::handle& images, const ChannelOrder& order) {
  if (py::isinstance<py::array>(images)) return {view_of(images, "images", order)};
  if (!py::isinstance<py::list>(images) && !py::isinstance<py::tuple>(images)) {
    throw py::type_error(fmt::format("images: {} is not allowed, a numpy array or a list of them is",
                                     std::string_view(Py_TYPE(images.ptr())->tp_name)));
  }
  std::vector<PixelView> out;
  for (const py::handle image : images) {
    out.push_back(image.is_none() ? PixelView{}
                                  : view_of(image, fmt::format("images[{}]", out.size()), order));
  }
  return out;
}

GrayImage mask_of(const py::handle& value, const std::string& argument) {
  if (value.is_none()) return {};
  const PixelView view = view_of(value, argument, kRgbOrder);
  if (view.format != PixelFormat::kGray) {
    throw py::value_error(fmt::format("{}: (height, width) is needed", argument));
  }
  GrayImage mask;
  ColorPlanes none;
  copy_pixels(view, &mask, &none);
  return mask;
}

// Those given, else those that the cameras name.
std::vector<GrayImage> masks_of(const Rig& rig, const py::object& given) {
  std::vector<GrayImage> masks;
  if (!given.is_none()) {
    const py::list list(given);
    for (const py::handle mask : list) masks.push_back(mask_of(mask, fmt::format("masks[{}]", masks.size())));
    return masks;
  }
  for (const Camera& camera : rig.cameras) {
    const bool has_one = !camera.mask_path.empty() && camera.width > 0;
    masks.push_back(has_one ? unwrap(read_mask(camera.mask_path, camera.width, camera.height)) : GrayImage());
  }
  return masks;
}

const char* state_name(TrackingState state) {
  if (state == TrackingState::kTracking) return "tracking";
  return state == TrackingState::kLost ? "lost" : "starting";
}

class PyTracker;

// Views of inputs, decoded ahead of time for one tracker.
struct ViewReader {
  std::shared_ptr<PyTracker> tracker;  // outlives the stream, whose masks it has
  Input input;
  std::unique_ptr<ViewStream> stream;
};

// A view, and who read it.
struct ReadView {
  ViewPtr view;
  std::shared_ptr<ViewReader> reader;
};

// One tracker, of which one thread at a time may ask something.
class PyTracker {
  static constexpr const char* kFinished = "finish() was the last call";

  // Does the work without the interpreter's lock, one thread at a time.
  template <typename Work>
  auto locked(const Work& work, bool when_finished = false) {
    auto result = [&]() -> decltype(work()) {
      const py::gil_scoped_release without_lock;
      const std::lock_guard lock(mutex_);
      if (finished_ && !when_finished) return internal_error(kFinished);
      return work();
    }();
    return unwrap(std::move(result));
  }

 public:
  PyTracker(Rig rig, const py::object& masks, const std::string& channels, const py::kwargs& given)
      : order_(order_of(channels)) {
    set_settings("Tracker", given, tracker_fields());
    TrackerOptions options{unwrap(odometry_options(settings_)), masks_of(rig, masks)};
    CalibrationPrior& prior = options.odometry.calibration_prior;
    unwrap(set_rolling_shutter(settings_.rolling_shutter, &rig, &prior));
    const py::gil_scoped_release without_lock;
    tracker_ = created(rig, std::move(options));
  }

  FrameResult push(const py::object& images, double timestamp, const std::string& name) {
    const std::vector<PixelView> pixels = views_of(images, order_);
    return locked([&] { return tracker_->push(pixels, timestamp, name); });
  }

  FrameResult push_view(const ReadView& read) {
    if (read.reader->tracker.get() != this) raise(bad_input("view: read for another tracker"));
    return locked([&]() -> Result<FrameResult> {
      if (read.view->frame != tracker_->frames()) {
        return bad_input(
            fmt::format("view: of frame {}; the next one is {}", read.view->frame, tracker_->frames()));
      }
      Result<FrameResult> frame = tracker_->push(read.view);
      if (frame) read.reader->stream->detect_ahead(frame->state != TrackingState::kTracking);
      return frame;
    });
  }

  std::shared_ptr<Reconstruction> snapshot() {
    return locked([&] { return Result(std::make_shared<Reconstruction>(tracker_->snapshot())); });
  }

  Run finish(bool adjust) {
    const auto result = std::make_shared<TrackResult>();
    LongCall call;
    unwrap(call.run([&]() -> Result<bool> {
      const std::lock_guard lock(mutex_);
      if (finished_) return internal_error(kFinished);
      finished_ = true;
      settings_.final = adjust ? "global" : "none";
      result->reconstruction = tracker_->finish(adjust);
      Report& report = result->report = tracker_report(settings_, *tracker_);
      report.frames_in_input = tracker_->frames();
      report.wall_s = milliseconds_since(start_) / 1000.0;
      report.frames_per_second = tracker_->frames() / report.wall_s;
      report.peak_rss_mib = peak_rss_mib();
      return true;
    }));
    return run_of(result,
                  [settings = settings_](const TrackResult& r, const std::string& path) -> Result<bool> {
                    if (auto ready = prepare_track_output(settings, path); !ready) return ready.error();
                    return write_track_output(r, settings, RAYSFM_VERSION, path);
                  });
  }

  const TrackSettings& settings() const { return settings_; }
  int frames() {
    return locked([&] { return Result(tracker_->frames()); }, true);
  }
  int posed() {
    return locked([&] { return Result(tracker_->posed()); }, true);
  }
  int first_movable_frame() {
    return locked([&] { return Result(tracker_->first_movable_frame()); }, true);
  }
  const ViewMaker& maker() const { return tracker_->maker(); }
  Rig rig() {
    return locked([&] { return Result(tracker_->rig().rig()); }, true);
  }

 private:
  // Settings of what is given to a tracker in another way, or not at all.
  std::vector<SettingField> tracker_fields() {
    std::vector<SettingField> fields = setting_fields(settings_);
    std::erase_if(fields, [](const SettingField& field) {
      for (const char* name :
           {"camera", "fov", "fps", "from", "to", "mono", "map", "save-map", "localise", "final"}) {
        if (field.name == name) return true;
      }
      return false;
    });
    return fields;
  }

  static std::unique_ptr<Tracker> created(const Rig& rig, TrackerOptions options) {
    Result<std::unique_ptr<Tracker>> made = Tracker::create(rig, std::move(options));
    if (made) return *std::move(made);
    const py::gil_scoped_acquire lock;
    raise(made.error());
  }

  ChannelOrder order_;
  TrackSettings settings_;
  std::unique_ptr<Tracker> tracker_;
  std::mutex mutex_;
  bool finished_ = false;
  Clock::time_point start_ = Clock::now();
};

std::shared_ptr<ViewReader> read_views(const std::shared_ptr<PyTracker>& tracker, const py::object& inputs,
                                       double fps, bool mono) {
  const std::vector<std::string> paths = paths_of(inputs, "inputs");
  if (paths.empty()) raise(bad_input("INPUT is missing"));
  unwrap(check_fps(fps));
  const int threads = tracker->settings().threads;
  auto reader = std::make_shared<ViewReader>();
  reader->tracker = tracker;
  reader->input =
      unwrap(open_input(paths, {.fps = fps, .mono = mono, .ignore_calibration = true, .threads = threads}));
  std::string note;
  unwrap(rig_for_streams(tracker->rig(), reader->input.streams, &note, mono));
  reader->stream =
      std::make_unique<ViewStream>(reader->input.streams, tracker->maker(), thread_count(threads));
  return reader;
}

ReadView next_view(const std::shared_ptr<ViewReader>& reader) {
  Result<ViewPtr> view = ViewPtr();
  {
    const py::gil_scoped_release without_lock;
    view = reader->stream->next();
  }
  ReadView read{unwrap(std::move(view)), reader};
  if (!read.view) throw py::stop_iteration();
  return read;
}

py::object pose_or_none(const FrameResult& frame) {
  return frame.pose ? py::object(matrix_of(frame.pose->world_from_rig)) : py::none();
}

void bind_frame(py::module_& module) {
  py::class_<FrameResult>(module, "Frame", "What is known of a frame once it was pushed.")
      .def_readonly("frame", &FrameResult::frame, "Counts the frames pushed, from 0.")
      .def_property_readonly(
          "state", [](const FrameResult& f) { return state_name(f.state); },
          "\"starting\", \"tracking\" or \"lost\".")
      .def_property_readonly(
          "world", [](const FrameResult& f) { return f.pose ? f.pose->world : -1; },
          "Counts the worlds started, from 0; -1 without a pose.")
      .def_property_readonly("pose", &pose_or_none, "world_from_rig, 4 x 4; None without a pose.")
      .def_property_readonly(
          "position",
          [](const FrameResult& f) {
            return f.pose ? py::object(array_of(f.pose->world_from_rig.translation)) : py::none();
          },
          "Of the rig in its world.")
      .def_property_readonly(
          "quaternion",
          [](const FrameResult& f) {
            return f.pose ? py::object(array_of(f.pose->world_from_rig.rotation.coeffs())) : py::none();
          },
          "x, y, z, w of world_from_rig.")
      .def_property_readonly(
          "covariance",
          [](const FrameResult& f) { return f.pose ? py::object(array_of(f.pose->covariance)) : py::none(); },
          "Of world_from_rig, 6 x 6: translation, then rotation, in the axes of the world.")
      .def_property_readonly(
          "reason", [](const FrameResult& f) { return text(f.reason); },
          "Why there is no pose, which the frame may get yet when a world starts.")
      .def("__repr__", [](const FrameResult& f) {
        return text(fmt::format("<raysfm.Frame {}: {}{}{}>", f.frame, state_name(f.state),
                                f.reason.empty() ? "" : ", ", f.reason));
      });
}

}  // namespace

void bind_tracker(py::module_& module) {
  bind_frame(module);
  py::class_<ReadView>(module, "View", "A frame that Tracker.views() read, to be pushed.")
      .def_property_readonly("timestamp", [](const ReadView& v) { return v.view->timestamp; })
      .def_property_readonly("name", [](const ReadView& v) { return text(v.view->name); });
  py::class_<ViewReader, std::shared_ptr<ViewReader>>(module, "Views", "What Tracker.views() gives.")
      .def("__iter__", [](const py::object& self) { return self; })
      .def("__next__", &next_view);
  py::class_<PyTracker, std::shared_ptr<PyTracker>>(
      module, "Tracker", "Poses of a calibrated rig, frame by frame: the pose is there when push() returns.")
      .def(py::init<Rig, const py::object&, const std::string&, const py::kwargs&>(), py::arg("rig"),
           py::kw_only(), py::arg("masks") = py::none(), py::arg("channels") = "rgb",
           "`masks`: for each camera an array, 255 where a pixel sees the scene, or None; those that the "
           "cameras "
           "name when left out. `channels`: order of colours, \"rgb\" or \"bgr\". Further keywords are "
           "options of "
           "`raysfm track` that do not concern files, \"-\" written as \"_\".")
      .def("push", &PyTracker::push_view, py::arg("view"), "A frame of views().")
      .def("push", &PyTracker::push, py::arg("images"), py::arg("timestamp"), py::arg("name") = "",
           "Images taken at one instant: a uint8 array (height, width), (height, width, 3) or (height, "
           "width, 4), "
           "or a list with one for each stream, None where an image did not arrive. Rows may lie anywhere in "
           "memory, and are not copied before they are looked at. `timestamp` in seconds, above that of the "
           "frame "
           "before.")
      .def("views", &read_views, py::arg("inputs"), py::kw_only(), py::arg("fps") = 0.0,
           py::arg("mono") = false,
           "Iterates over the frames of a video, images or a sequence, decoded ahead of time on other "
           "threads as "
           "`raysfm track` does.")
      .def("snapshot", &PyTracker::snapshot, "What is known now, a Reconstruction; changes nothing.")
      .def("finish", &PyTracker::finish, py::arg("adjust") = false,
           "No more frames will come. Adjusts everything when told so. A Run, as of track().")
      .def_property_readonly("frames", &PyTracker::frames, "Pushed so far.")
      .def_property_readonly("posed", &PyTracker::posed, "Those with a pose.")
      .def_property_readonly("first_movable_frame", &PyTracker::first_movable_frame,
                             "Frames before it keep their poses.")
      .def_property_readonly("rig", &PyTracker::rig, "The cameras, as refined so far.");
}

}  // namespace raysfm::python
