#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <variant>

#include "raysfm/camera_files/camera_convert.h"
#include "raysfm/core/median.h"
#include "raysfm/exports/scene_formats.h"
#include "raysfm/files/atomic_file.h"
#include "raysfm/files/base64.h"
#include "raysfm/files/little_endian.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr double kSensorWidth = 36;  // millimetres; only its ratio to the focal length counts

// What runs in Blender, behind `data = json.loads(...)`.
constexpr const char* kScript = R"PY(
scene = bpy.context.scene
if not bpy.data.filepath:  # what a new file begins with stands in the way
    for name in ("Cube", "Camera"):
        if name in bpy.data.objects:
            bpy.data.objects.remove(bpy.data.objects[name])
collection = bpy.data.collections.new("raysfm")
scene.collection.children.link(collection)
root = bpy.data.objects.new("raysfm world", None)
root.rotation_euler = (-math.pi / 2, 0, 0)  # y down becomes z up
collection.objects.link(root)

scene.render.resolution_x, scene.render.resolution_y = data["resolution"]
scene.render.resolution_percentage = 100
scene.render.pixel_aspect_x, scene.render.pixel_aspect_y = data["pixel_aspect"]
scene.render.fps, scene.render.fps_base = data["fps"]
scene.frame_start, scene.frame_end = data["frames"]

for camera in data["cameras"]:
    lens = bpy.data.cameras.new(camera["name"])
    lens.sensor_fit, lens.sensor_width, lens.lens_unit = "HORIZONTAL", data["sensor_width"], "MILLIMETERS"
    item = bpy.data.objects.new(camera["name"], lens)
    item.parent, item.rotation_mode = root, "QUATERNION"
    collection.objects.link(item)
    if scene.camera is None or camera is data["cameras"][0]:
        scene.camera = item
    before = None
    for frame, location, rotation, optics in camera["poses"]:
        item.location, item.rotation_quaternion = location, rotation
        item.keyframe_insert("location", frame=frame)
        item.keyframe_insert("rotation_quaternion", frame=frame)
        if optics != before:
            lens.lens, lens.shift_x, lens.shift_y = optics
            for name in ("lens", "shift_x", "shift_y"):
                lens.keyframe_insert(name, frame=frame)
        before = optics
    for animated in (item, lens):
        action = animated.animation_data.action if animated.animation_data else None
        for curve in getattr(action, "fcurves", []):  # newer ones have them elsewhere, and curve between frames
            for key in curve.keyframe_points:
                key.interpolation = "LINEAR"
for frame, name in data["markers"]:
    scene.timeline_markers.new(name, frame=frame)

points = array.array("f", base64.b64decode(data["points"]))
colours = base64.b64decode(data["colours"])
mesh = bpy.data.meshes.new("raysfm points")
mesh.vertices.add(len(points) // 3)
mesh.vertices.foreach_set("co", points)
if hasattr(mesh, "color_attributes") and colours:
    attribute = mesh.color_attributes.new("colour", "BYTE_COLOR", "POINT")
    values = array.array("f", (v / 255 for i in range(0, len(colours), 3) for v in (*colours[i:i + 3], 255)))
    attribute.data.foreach_set("color_srgb" if hasattr(attribute.data[0], "color_srgb") else "color", values)
mesh.update()
item = bpy.data.objects.new("raysfm points", mesh)
item.parent = root
collection.objects.link(item)
scene.frame_set(scene.frame_start)
)PY";

// The pinhole that a camera is, whatever its model is called.
std::optional<Pinhole> pinhole_of(const Camera& camera) {
  for (const CameraModel& model : equivalent_models(camera.model)) {
    if (const auto* pinhole = std::get_if<Pinhole>(&model)) return *pinhole;
  }
  return std::nullopt;
}

double aspect_of(const Pinhole& pinhole) {
  return pinhole.fx / pinhole.fy;
}

// Millimetres and shifts, in widths of the sensor.
Json optics(const Camera& camera) {
  const Pinhole m = *pinhole_of(camera);
  const double width = camera.width;
  return {m.fx * kSensorWidth / width, (width / 2 - (m.cx + 0.5)) / width,
          aspect_of(m) * ((m.cy + 0.5) - camera.height / 2.0) / width};
}

// Of a camera that looks along -z with y up.
Json pose(const Rigid3& world_from_cam, Eigen::Quaterniond* before) {
  Eigen::Quaterniond q = world_from_cam.rotation * Eigen::Quaterniond(0, 1, 0, 0);
  if (q.dot(*before) < 0) q.coeffs() *= -1;  // or it would turn round between two frames
  *before = q;
  const Eigen::Vector3d& t = world_from_cam.translation;
  return {{t.x(), t.y(), t.z()}, {q.w(), q.x(), q.y(), q.z()}};
}

// The images of a frame stand in the order of its cameras, each of which is one track.
Json animated_cameras(const ExportScene& scene) {
  Json cameras = Json::array();
  std::vector<Eigen::Quaterniond> before;
  size_t track = 0;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const ExportImage& image = scene.images[i];
    track = i > 0 && scene.images[i - 1].frame == image.frame ? track + 1 : 0;
    const Camera& camera = scene.cameras[image.camera];
    if (track == cameras.size()) {
      const bool named = scene.rig && !camera.name.empty();
      cameras.push_back({{"name", named ? camera.name : "camera"}, {"poses", Json::array()}});
      before.push_back(Eigen::Quaterniond::Identity());
    }
    const Json placed = pose(image.world_from_cam, &before[track]);
    cameras[track]["poses"].push_back({image.frame + 1, placed[0], placed[1], optics(camera)});
  }
  return cameras;
}

// Where poses end, why, and where they begin again.
Json markers(const Reconstruction& world) {
  Json list = Json::array();
  bool posed = true;
  for (size_t f = 0; f < world.frames.size(); ++f) {
    const PosedFrame& frame = world.frames[f];
    if (frame.world_from_rig.has_value() == posed) continue;
    posed = !posed;
    list.push_back({f + 1, posed ? std::string("poses again") : "no pose: " + frame.reason});
  }
  return list;
}

double frames_per_second(const Reconstruction& world) {
  std::vector<double> steps;
  for (size_t f = 1; f < world.frames.size(); ++f) {
    steps.push_back(world.frames[f].timestamp - world.frames[f - 1].timestamp);
  }
  const double step = median_of(&steps);
  return step > 1e-3 && step <= 1 ? 1 / step : 24;
}

void embed_points(const ExportScene& scene, Json* data) {
  std::string positions, colours;
  for (const MapPoint& point : scene.points) {
    for (int i = 0; i < 3; ++i) append_little_endian(positions, static_cast<float>(point.position[i]));
    for (const uint8_t channel : point.rgb) append_little_endian(colours, channel);
  }
  (*data)["points"] = base64(positions);
  (*data)["colours"] = base64(colours);
}

// One size and one shape of pixels for all.
Result<void> check_alike(const ExportScene& scene) {
  for (const Camera& camera : scene.cameras) {
    const Camera& first = scene.cameras.front();
    if (camera.width != first.width || camera.height != first.height) {
      return bad_input(
          fmt::format("Blender has one size of images for all cameras, here are {} x {} and {} x {}; "
                      "--format colmap or nerfstudio can",
                      first.width, first.height, camera.width, camera.height));
    }
    if (std::abs(aspect_of(*pinhole_of(camera)) / aspect_of(*pinhole_of(first)) - 1) > 1e-9) {
      return bad_input(
          "Blender has one shape of pixels for all cameras, here they differ; --undistort makes all square");
    }
  }
  return {};
}

}  // namespace

Result<void> blender_holds(const Camera& camera) {
  if (camera.width <= 0 || camera.height <= 0) return bad_input("the size of its images is not known");
  if (pinhole_of(camera)) return {};
  return bad_input("pinhole cameras are held");
}

Result<void> write_blender(const Reconstruction& world, const ExportScene& scene, const fs::path& folder) {
  if (auto alike = check_alike(scene); !alike) return alike;
  const bool any = !scene.cameras.empty();
  const double aspect = any ? aspect_of(*pinhole_of(scene.cameras[0])) : 1, fps = frames_per_second(world);
  const long whole = std::max(1L, std::lround(fps));
  Json data;
  data["resolution"] = {any ? scene.cameras[0].width : 1, any ? scene.cameras[0].height : 1};
  data["pixel_aspect"] = {std::max(1.0, 1 / aspect), std::max(1.0, aspect)};
  data["fps"] = {whole, static_cast<double>(whole) / fps};
  data["frames"] = {1, std::max<size_t>(1, world.frames.size())};
  data["sensor_width"] = kSensorWidth;
  data["cameras"] = animated_cameras(scene);
  data["markers"] = markers(world);
  embed_points(scene, &data);
  std::string json;
  try {
    json = data.dump(-1, ' ', true);
  } catch (const Json::exception&) {
    return bad_input("the name of a camera is not UTF-8, which Python cannot hold");
  }
  for (size_t at = json.find('\''); at != json.npos; at = json.find('\'', at)) json.replace(at, 1, "\\u0027");
  return write_file(folder / "scene.py",
                    fmt::format("# Builds the scene in Blender: blender --python scene.py\n"
                                "import array, base64, json, math\n\nimport bpy\n\n"
                                "data = json.loads(r'''{}''')\n{}",
                                json, kScript));
}

}  // namespace raysfm
