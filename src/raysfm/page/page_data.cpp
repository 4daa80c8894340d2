#include "raysfm/page/page_data.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <vector>

#include "raysfm/camera/pixel_finder.h"
#include "raysfm/files/base64.h"
#include "raysfm/files/little_endian.h"
#include "raysfm/scene/worlds.h"

namespace raysfm {
namespace {

using Json = nlohmann::ordered_json;

constexpr size_t kMostPoints = 300000;  // of a world
constexpr size_t kFirstPoints = 30000;  // of all: what viewer/src/scene.js draws first

const char* command_of(Origin origin) {
  if (origin == Origin::kTrack) return "track";
  return origin == Origin::kSolve ? "solve" : "adjust";
}

// Collects numbers of one kind.
template <typename T>
struct Numbers {
  std::string bytes;
  void add(double number) { append_little_endian(bytes, static_cast<T>(number)); }
  void add(const Eigen::Vector3d& v) {
    for (const double number : v) add(number);
  }
  std::string text() const { return base64(bytes); }
  // Of so many groups of three at the beginning, and of what is behind them.
  std::string first(size_t count) const { return base64(bytes.substr(0, 3 * sizeof(T) * count)); }
  std::string rest(size_t count) const { return base64(bytes.substr(3 * sizeof(T) * count)); }
};

// Directions of the border of the image, inwards where its rim sees nothing; in the rig. Those of a camera
// that is not wide lie in a plane, so that it looks like one.
Json camera_json(const Camera& camera, const std::string& name) {
  constexpr int kSide = 6;
  constexpr double kLeastCosine = 0.4;  // of a camera that is not wide
  std::vector<Eigen::Vector3d> border;
  const double width = camera.width - 1, height = camera.height - 1;
  for (int i = 0; i < 4 * kSide; ++i) {
    const double along = static_cast<double>(i % kSide) / kSide;
    const std::array<Eigen::Vector2d, 4> rim = {
        Eigen::Vector2d{along, 0}, {1, along}, {1 - along, 1}, {0, 1 - along}};
    const Eigen::Vector2d middle(0.5, 0.5);
    const Eigen::Vector2d& edge = rim[i / kSide];
    for (double inwards = 0; inwards < 1; inwards += 0.02) {
      const Eigen::Vector2d at = edge + inwards * (middle - edge);
      Ray ray;
      if (!camera.ray({at.x() * width, at.y() * height}, &ray)) continue;
      border.push_back(ray.direction);
      break;
    }
  }
  const bool wide =
      std::ranges::any_of(border, [](const Eigen::Vector3d& d) { return d.z() < kLeastCosine; });
  Json directions = Json::array();
  for (const Eigen::Vector3d& direction : border) {
    const Eigen::Vector3d d = camera.rig_from_cam.rotation * (wide ? direction : direction / direction.z());
    directions.push_back({static_cast<float>(d.x()), static_cast<float>(d.y()), static_cast<float>(d.z())});
  }
  const Eigen::Vector3d& t = camera.rig_from_cam.translation;
  return {{"name", name},
          {"size", {camera.width, camera.height}},
          {"position", {t.x(), t.y(), t.z()}},
          {"directions", std::move(directions)}};
}

// Rays of the pixels of a grid, in the rig.
void add_rays(const Camera& camera, Json* json) {
  constexpr int kColumns = 16, kRows = 12;
  Numbers<float> rays;
  for (int k = 0; k < kColumns * kRows; ++k) {
    const Eigen::Vector2d part(static_cast<double>(k % kColumns) / (kColumns - 1),
                               static_cast<double>(k / kColumns) / (kRows - 1));
    Ray ray;
    if (!camera.ray({part.x() * (camera.width - 1), part.y() * (camera.height - 1)}, &ray)) {
      ray.origin.setConstant(std::numeric_limits<double>::quiet_NaN());
    }
    rays.add(camera.rig_from_cam * ray.origin);
    rays.add(Eigen::Vector3d(camera.rig_from_cam.rotation * ray.direction));
  }
  (*json)["grid"] = {kColumns, kRows};
  (*json)["rays"] = rays.text();
}

Json rig_camera_json(const Camera& camera) {
  Json json = camera_json(camera, camera.name);
  add_rays(camera, &json);
  return json;
}

Json lens_json(const FrameLens& frame_lens, bool only) {
  Json json = camera_json(frame_lens.camera, "lens");
  if (only) add_rays(frame_lens.camera, &json);
  if (const std::optional<Lens> lens = lens_of(frame_lens)) {
    json["focal"] = {lens->fx, lens->fy};
    if (std::isfinite(frame_lens.sigma[0])) json["sigma"] = frame_lens.sigma[0];
  }
  return json;
}

Json frames_json(const Reconstruction& whole, int segment) {
  Numbers<uint32_t> index;
  Numbers<double> time;
  Numbers<float> pose, covariance, turn;
  Numbers<int32_t> lens;
  int count = 0;
  for (size_t f = 0; f < whole.frames.size(); ++f) {
    const PosedFrame& frame = whole.frames[f];
    if (!frame.world_from_rig || frame.segment != segment) continue;
    ++count;
    index.add(static_cast<double>(f));
    time.add(frame.timestamp);
    pose.add(frame.world_from_rig->translation);
    for (const double number : frame.world_from_rig->rotation.coeffs()) pose.add(number);
    for (int i = 0; i < 3; ++i) {
      for (int j = i; j < 3; ++j) covariance.add(frame.covariance(i, j));
    }
    const double variance = std::max(0.0, frame.covariance.bottomRightCorner<3, 3>().trace() / 3);
    turn.add(std::sqrt(variance) * 180 / std::numbers::pi);
    lens.add(frame.lens);
  }
  return {{"count", count},      {"index", index.text()},           {"time", time.text()},
          {"pose", pose.text()}, {"covariance", covariance.text()}, {"turn", turn.text()},
          {"lens", lens.text()}};
}

// Root mean square over a key frame's observations, NaN where it has none. `finders`: of the rig's cameras.
double rms_error(const Reconstruction& world, const std::vector<PixelFinder>& finders,
                 const KeyFrame& keyframe) {
  const PosedFrame& frame = world.frames[keyframe.frame];
  double sum = 0;
  int count = 0;
  for (int k = keyframe.first_observation; k < keyframe.last_observation; ++k) {
    const Observation& o = world.observations[k];
    if (frame.lens < 0 && o.camera >= static_cast<int>(world.rig.cameras.size())) continue;
    const Camera& camera = camera_of(world, frame, o.camera);
    Eigen::Vector2d pixel;
    const Rigid3 cam_from_world = (*frame.world_from_rig * camera.rig_from_cam).inverse();
    const Eigen::Vector3d point = cam_from_world * world.points[o.point].position;
    const bool found =
        frame.lens >= 0 ? camera.project(point, &pixel) : finders[o.camera].find(point, &pixel);
    if (!found) continue;
    sum += (pixel - o.pixel).squaredNorm();
    ++count;
  }
  return count > 0 ? std::sqrt(sum / count) : std::numeric_limits<double>::quiet_NaN();
}

Json keyframes_json(const Reconstruction& world) {
  Numbers<uint32_t> frame, seen;
  Numbers<float> error;
  std::vector<int> numbers(world.frames.size(), 0);  // of each frame among those with a pose
  for (size_t f = 1; f < numbers.size(); ++f)
    numbers[f] = numbers[f - 1] + world.frames[f - 1].world_from_rig.has_value();
  const std::vector<PixelFinder> finders(world.rig.cameras.begin(), world.rig.cameras.end());
  for (const KeyFrame& keyframe : world.keyframes) {
    frame.add(numbers[keyframe.frame]);
    seen.add(keyframe.last_observation - keyframe.first_observation);
    error.add(rms_error(world, finders, keyframe));
  }
  return {{"count", world.keyframes.size()},
          {"frame", frame.text()},
          {"seen", seen.text()},
          {"error", error.text()}};
}

// Box of the path and of all but the farthest points, with as much again around it.
struct Box {
  Eigen::Vector3d low = Eigen::Vector3d::Zero(), high = Eigen::Vector3d::Zero();
  bool contains(const Eigen::Vector3d& x) const {
    return (x.array() >= low.array() && x.array() <= high.array()).all();
  }
};

Box box_of(const Reconstruction& world) {
  Box box;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> values;
    for (const MapPoint& point : world.points) {
      if (std::isfinite(point.position[axis])) values.push_back(point.position[axis]);
    }
    std::ranges::sort(values);
    double low = std::numeric_limits<double>::infinity(), high = -low;
    if (!values.empty())
      low = values[values.size() / 50], high = values[values.size() - 1 - values.size() / 50];
    for (const PosedFrame& frame : world.frames) {
      if (!frame.world_from_rig) continue;
      low = std::min(low, frame.world_from_rig->translation[axis]);
      high = std::max(high, frame.world_from_rig->translation[axis]);
    }
    box.low[axis] = low;
    box.high[axis] = high;
  }
  const double margin = std::max(1e-9, (box.high - box.low).maxCoeff());
  box.low.array() -= margin;
  box.high.array() += margin;
  return box;
}

// Points of a world as the page shows them, in an order of which any beginning is spread evenly.
struct PagePoints {
  Json numbers;
  size_t count = 0;
  Numbers<uint16_t> xyz;
  Numbers<uint8_t> rgb;
};

// Numbers up to `count` as those come whose bits, read from the right to the left, count up.
std::vector<size_t> evenly_spread(size_t count) {
  std::vector<size_t> order;
  order.reserve(count);
  const size_t end = std::bit_ceil(count);
  size_t number = 0;
  for (size_t i = 0; i < end; ++i) {
    if (number < count) order.push_back(number);
    size_t bit = end / 2;
    for (; (number & bit) != 0; bit /= 2) number ^= bit;
    number |= bit;
  }
  return order;
}

PagePoints page_points(const Reconstruction& world) {
  const Box box = box_of(world);
  std::vector<const MapPoint*> near;
  for (const MapPoint& point : world.points) {
    if (box.contains(point.position)) near.push_back(&point);
  }
  PagePoints points;
  points.count = std::min(near.size(), kMostPoints);
  for (const size_t i : evenly_spread(points.count)) {
    const MapPoint& point = *near[i * near.size() / points.count];
    const Eigen::Vector3d part = (point.position - box.low).cwiseQuotient(box.high - box.low);
    points.xyz.add(Eigen::Vector3d((65535 * part).array().round()));
    for (const uint8_t channel : point.rgb) points.rgb.add(channel);
  }
  points.numbers = {{"count", points.count},
                    {"all", near.size()},
                    {"far", world.points.size() - near.size()},
                    {"low", {box.low.x(), box.low.y(), box.low.z()}},
                    {"high", {box.high.x(), box.high.y(), box.high.z()}}};
  return points;
}

Json world_json(const Reconstruction& whole, int segment, PagePoints* points) {
  // The only world is not copied.
  std::optional<Reconstruction> part;
  if (whole.segments.size() > 1) part = world_of(whole, segment);
  const Reconstruction& world = part ? *part : whole;
  Json json = {{"metric", world.metric_scale}};
  json["scale_sigma"] = world.scale_sigma ? Json(*world.scale_sigma) : Json();
  json["frames"] = frames_json(whole, segment);
  json["keyframes"] = keyframes_json(world);
  *points = page_points(world);
  return json;
}

// Adds the worlds to what comes first, with the same part of the points of each, and makes the rest.
Json add_worlds(const Reconstruction& r, Json* first) {
  Json& worlds = (*first)["worlds"] = Json::array();
  Json rest = Json::array();
  std::vector<PagePoints> points;
  size_t all = 0;
  for (const int segment : worlds_in_order(r)) {
    worlds.push_back(world_json(r, segment, &points.emplace_back()));
    all += points.back().count;
  }
  for (size_t w = 0; w < points.size(); ++w) {
    const PagePoints& p = points[w];
    const size_t begin = p.count * kFirstPoints / std::max(all, kFirstPoints);
    Json& json = worlds[w]["points"] = p.numbers;
    json["xyz"] = p.xyz.first(begin);
    json["rgb"] = p.rgb.first(begin);
    rest.push_back({{"xyz", p.xyz.rest(begin)}, {"rgb", p.rgb.rest(begin)}});
  }
  return rest;
}

// No character of it ends a script.
std::string text_of(const Json& json) {
  std::string text = json.dump(-1, ' ', true, Json::error_handler_t::replace);
  for (size_t at = text.find('<'); at != text.npos; at = text.find('<', at)) text.replace(at, 1, "\\u003c");
  return text;
}

// Runs of frames without a pose for the same reason.
Json missing_json(const Reconstruction& r) {
  Json runs = Json::array();
  for (size_t f = 0; f < r.frames.size(); ++f) {
    if (r.frames[f].world_from_rig) continue;
    if (!runs.empty() && runs.back()["last"] == f - 1 && runs.back()["reason"] == r.frames[f].reason) {
      runs.back()["last"] = f;
    } else {
      runs.push_back({{"first", f}, {"last", f}, {"reason", r.frames[f].reason}});
    }
  }
  return runs;
}

Json held_json(const Reconstruction& r) {
  Json runs = Json::array();
  for (const FrameRun& run : place_held_runs(r.frames)) {
    runs.push_back({{"first", run.first}, {"last", run.last}});
  }
  return runs;
}

Json closures_json(const Reconstruction& r) {
  Json closures = Json::array();
  for (const Closure& c : r.closures) {
    closures.push_back(
        {{"frame", c.frame}, {"with", c.with_frame}, {"inliers", c.inliers}, {"joined", c.joined_worlds}});
  }
  return closures;
}

Json stages_json(const PageInfo& info) {
  Json stages = Json::array();
  for (const StageTime& s : info.stages) {
    stages.push_back({{"name", s.name}, {"mean", s.mean_ms}, {"max", s.max_ms}, {"count", s.count}});
  }
  return stages;
}

Json mesh_json(const PageMesh& mesh) {
  Numbers<float> positions;
  Numbers<uint32_t> faces;
  Numbers<uint16_t> places;
  for (const float x : mesh.positions) positions.add(x);
  for (const uint32_t vertex : mesh.faces) faces.add(vertex);
  for (const uint16_t place : mesh.places) places.add(place);
  return {{"world", mesh.world},
          {"positions", positions.text()},
          {"faces", faces.text()},
          {"places", places.text()},
          {"texture", base64(mesh.jpeg)}};
}

}  // namespace

PageData page_data(const Reconstruction& r, const PageInfo& info) {
  Json json = {{"title", info.title}, {"command", command_of(r.origin)}, {"total", r.frames.size()}};
  json["rms"] = r.rms_reprojection_px;
  json["posed"] = posed_count(r);
  json["pictures"] = info.pictures;
  json["live"] = info.live.has_value();
  if (info.live) json["last"] = info.live->frame, json["liveWorld"] = info.live->world;
  json["cameras"] = Json::array();
  for (const Camera& camera : r.rig.cameras) json["cameras"].push_back(rig_camera_json(camera));
  json["lenses"] = Json::array();
  for (const FrameLens& lens : r.lenses) json["lenses"].push_back(lens_json(lens, r.lenses.size() == 1));
  const Json rest = add_worlds(r, &json);
  json["missing"] = missing_json(r);
  json["held"] = held_json(r);
  json["closures"] = closures_json(r);
  json["stages"] = stages_json(info);
  json["warnings"] = info.warnings;
  if (info.mesh) json["mesh"] = mesh_json(*info.mesh);
  return {text_of(json), text_of(rest)};
}

}  // namespace raysfm
