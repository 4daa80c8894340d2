#include "raysfm/scene/reconstruction.h"

#include <fmt/format.h>
#include <pybind11/stl.h>

#include <cmath>
#include <memory>

#include "long_call.h"
#include "raysfm/results/reconstruction_folder.h"
#include "raysfm/scene/worlds.h"
#include "run.h"
#include "support.h"

namespace raysfm::python {
namespace {

using namespace py::literals;

using Poses = std::shared_ptr<const Reconstruction>;

// An array of one entry for each frame: `entry` writes that of a frame with a pose, others are NaN.
template <typename Entry>
py::array_t<double> of_frames(const Reconstruction& r, std::vector<py::ssize_t> shape, const Entry& entry) {
  py::ssize_t size = 1;
  for (const py::ssize_t side : shape) size *= side;
  shape.insert(shape.begin(), static_cast<py::ssize_t>(r.frames.size()));
  py::array_t<double> out(shape);
  double* data = out.mutable_data();
  for (const PosedFrame& frame : r.frames) {
    if (frame.world_from_rig) {
      entry(frame, data);
    } else {
      std::fill_n(data, size, NAN);
    }
    data += size;
  }
  return out;
}

py::array_t<double> poses(const Reconstruction& r) {
  return of_frames(r, {4, 4}, [](const PosedFrame& frame, double* out) {
    Eigen::Map<Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> matrix(out);
    matrix.setIdentity();
    matrix.topLeftCorner<3, 3>() = frame.world_from_rig->rotation.toRotationMatrix();
    matrix.topRightCorner<3, 1>() = frame.world_from_rig->translation;
  });
}

py::array_t<double> positions(const Reconstruction& r) {
  return of_frames(r, {3}, [](const PosedFrame& frame, double* out) {
    Eigen::Vector3d::Map(out) = frame.world_from_rig->translation;
  });
}

py::array_t<double> quaternions(const Reconstruction& r) {
  return of_frames(r, {4}, [](const PosedFrame& frame, double* out) {
    Eigen::Vector4d::Map(out) = frame.world_from_rig->rotation.coeffs();
  });
}

py::array_t<double> covariances(const Reconstruction& r) {
  return of_frames(r, {6, 6}, [](const PosedFrame& frame, double* out) {
    Eigen::Map<Matrix6d> matrix(out);
    matrix = frame.covariance.transpose();
  });
}

template <typename T, typename Items, typename Get>
py::array_t<T> list_of(const Items& items, const Get& get) {
  py::array_t<T> out(static_cast<py::ssize_t>(items.size()));
  T* data = out.mutable_data();
  for (const auto& item : items) *data++ = static_cast<T>(get(item));
  return out;
}

template <typename Get>
py::list texts_of(const Reconstruction& r, const Get& get) {
  py::list out;
  for (const PosedFrame& frame : r.frames) out.append(text(get(frame)));
  return out;
}

py::array_t<double> points(const Reconstruction& r) {
  py::array_t<double> out({static_cast<py::ssize_t>(r.points.size()), py::ssize_t{3}});
  double* data = out.mutable_data();
  for (const MapPoint& point : r.points) {
    Eigen::Vector3d::Map(data) = point.position;
    data += 3;
  }
  return out;
}

py::array_t<uint8_t> colors(const Reconstruction& r) {
  py::array_t<uint8_t> out({static_cast<py::ssize_t>(r.points.size()), py::ssize_t{3}});
  uint8_t* data = out.mutable_data();
  for (const MapPoint& point : r.points) data = std::copy(point.rgb.begin(), point.rgb.end(), data);
  return out;
}

py::dict observations(const Reconstruction& r) {
  const auto count = static_cast<py::ssize_t>(r.observations.size());
  py::array_t<int> keyframe(count);
  std::fill_n(keyframe.mutable_data(), count, -1);
  for (size_t k = 0; k < r.keyframes.size(); ++k) {
    const KeyFrame& frame = r.keyframes[k];
    std::fill(keyframe.mutable_data() + frame.first_observation,
              keyframe.mutable_data() + frame.last_observation, static_cast<int>(k));
  }
  py::array_t<double> pixels({count, py::ssize_t{2}});
  double* data = pixels.mutable_data();
  for (const Observation& seen : r.observations) {
    Eigen::Vector2d::Map(data) = seen.pixel;
    data += 2;
  }
  return py::dict("keyframe"_a = keyframe,
                  "point"_a = list_of<int>(r.observations, [](const auto& o) { return o.point; }),
                  "camera"_a = list_of<int>(r.observations, [](const auto& o) { return o.camera; }),
                  "pixel"_a = pixels);
}

py::list worlds(const Reconstruction& r) {
  py::list out;
  for (const int number : worlds_in_order(r)) {
    const Segment& segment = r.segments[number];
    out.append(py::dict("segment"_a = number, "first"_a = segment.first, "last"_a = segment.last,
                        "reason"_a = text(segment.reason), "metric_scale"_a = segment.metric_scale,
                        "scale_sigma"_a = segment.scale_sigma));
  }
  return out;
}

py::list closures(const Reconstruction& r) {
  py::list out;
  for (const Closure& c : r.closures) {
    out.append(py::dict("frame"_a = c.frame, "with_frame"_a = c.with_frame, "inliers"_a = c.inliers,
                        "joined_worlds"_a = c.joined_worlds, "correction"_a = c.correction));
  }
  return out;
}

py::list calibration(const Reconstruction& r) {
  py::list out;
  for (const CalibrationNumber& n : r.calibration) {
    out.append(py::dict("camera"_a = n.camera, "name"_a = text(n.name), "given"_a = n.given,
                        "refined"_a = n.refined, "sigma"_a = n.sigma, "told"_a = n.told));
  }
  return out;
}

py::list lenses(const Reconstruction& r) {
  py::list out;
  for (const FrameLens& lens : r.lenses) {
    out.append(py::dict("camera"_a = lens.camera, "skew"_a = lens.skew, "sigma"_a = array_of(lens.sigma)));
  }
  return out;
}

Poses read(const py::handle& path) {
  const std::string folder = path_of(path);
  LongCall call;
  return std::make_shared<Reconstruction>(unwrap(call.run([&] { return read_reconstruction(folder); })));
}

void bind_frames_of(py::class_<Reconstruction, std::shared_ptr<Reconstruction>>& type) {
  const auto number = [](auto get) {
    return [get](const Reconstruction& r) { return list_of<int>(r.frames, get); };
  };
  type.def_property_readonly(
          "timestamps",
          [](const Reconstruction& r) {
            return list_of<double>(r.frames, [](const PosedFrame& f) { return f.timestamp; });
          },
          "Seconds, (frames,).")
      .def_property_readonly(
          "posed",
          [](const Reconstruction& r) {
            return list_of<bool>(r.frames, [](const PosedFrame& f) { return f.world_from_rig.has_value(); });
          },
          "Which frames have a pose.")
      .def_property_readonly("poses", &poses, "world_from_rig, (frames, 4, 4); NaN without a pose.")
      .def_property_readonly("positions", &positions,
                             "Of the rig in its world, (frames, 3); NaN without a pose.")
      .def_property_readonly("quaternions", &quaternions,
                             "x, y, z, w of world_from_rig, (frames, 4); NaN without a pose.")
      .def_property_readonly(
          "covariances", &covariances,
          "Of world_from_rig, (frames, 6, 6): translation, then rotation, in the axes of the "
          "world; NaN without a pose.")
      .def_property_readonly(
          "segment_of_frame", number([](const PosedFrame& f) { return f.segment; }),
          "The segment that has the pose, -1 without; segments share neither frame nor scale.")
      .def_property_readonly("place_held", number([](const PosedFrame& f) { return int{f.place_held}; }),
                             "1 where only the turning of a frame was seen, and its place is held; else 0.")
      .def_property_readonly("lens_of_frame", number([](const PosedFrame& f) { return f.lens; }),
                             "Index into `lenses`, -1: the rig's, or unknown.")
      .def_property_readonly(
          "reasons",
          [](const Reconstruction& r) { return texts_of(r, [](const auto& f) { return f.reason; }); },
          "Why a frame has no pose; empty where it has one.")
      .def_property_readonly(
          "names",
          [](const Reconstruction& r) { return texts_of(r, [](const auto& f) { return f.image_name; }); },
          "Of the images.");
}

void bind_map_of(py::class_<Reconstruction, std::shared_ptr<Reconstruction>>& type) {
  type.def_property_readonly(
          "rig", [](const Reconstruction& r) { return r.rig; }, "The cameras, as refined.")
      .def_property_readonly("calibration", &calibration, "Numbers of the cameras, given and refined.")
      .def_property_readonly("lenses", &lenses, "Where they are not the rig's: camera, skew and sigmas.")
      .def_readonly("metric_scale", &Reconstruction::metric_scale, "Whether lengths are metres.")
      .def_readonly("scale_sigma", &Reconstruction::scale_sigma,
                    "Standard deviation of the logarithm of the scale, None where nothing tells it.")
      .def_property_readonly(
          "keyframes",
          [](const Reconstruction& r) {
            return list_of<int>(r.keyframes, [](const KeyFrame& k) { return k.frame; });
          },
          "Their frames.")
      .def_property_readonly("points", &points, "(points, 3), each in the world of its segment.")
      .def_property_readonly("colors", &colors, "Red, green, blue of the points, (points, 3), uint8.")
      .def_property_readonly(
          "segment_of_point",
          [](const Reconstruction& r) {
            return list_of<int>(r.points, [](const MapPoint& p) { return p.segment; });
          },
          "The segment of each point.")
      .def_property_readonly("observations", &observations,
                             "Which key frame sees which point where: arrays keyframe, point, camera, pixel.")
      .def_property_readonly("worlds", &worlds, "What each world is, the main one first.")
      .def_property_readonly("closures", &closures, "Places that were seen again.")
      .def_readonly("rms_reprojection_px", &Reconstruction::rms_reprojection_px, "Over the observations.")
      .def("__repr__", [](const Reconstruction& r) {
        return fmt::format("<raysfm.Reconstruction: {} of {} frames posed, {} points>", posed_count(r),
                           r.frames.size(), r.points.size());
      });
}

}  // namespace

void bind_reconstruction(py::module_& module) {
  py::class_<Reconstruction, std::shared_ptr<Reconstruction>> type(
      module, "Reconstruction", "Poses of frames, and the map. Every array is a copy.");
  bind_frames_of(type);
  bind_map_of(type);
  py::class_<Run>(module, "Run", "What track, solve, adjust and Tracker.finish give.")
      .def_property_readonly("reconstruction", [](const Run& run) { return run.reconstruction; })
      .def_property_readonly(
          "report",
          [](const Run& run) { return py::module_::import("json").attr("loads")(text(run.report)); },
          "The content of report.json, a dict.")
      .def("write", &write_run, py::arg("folder"),
           "Writes what the program writes. False where there is no pose and an older result stays.");
  module.def("read_reconstruction", &read, py::arg("folder"),
             "What track, solve or adjust left in a folder.");
}

bool write_run(const Run& run, const py::handle& folder) {
  const std::string path = path_of(folder);
  LongCall call;
  return unwrap(call.run([&] { return run.write(path); }));
}

}  // namespace raysfm::python
