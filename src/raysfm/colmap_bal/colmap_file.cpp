#include "raysfm/colmap_bal/colmap_file.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "raysfm/colmap_bal/colmap_format.h"
#include "raysfm/colmap_bal/colmap_model.h"
#include "raysfm/files/atomic_file.h"
#include "raysfm/files/little_endian.h"

namespace raysfm {
namespace {

// nullopt where COLMAP has no such model. The distortion of an estimated lens is COLMAP's RADIAL.
std::optional<ColmapCamera> colmap_camera_of(const Camera& camera, bool estimated) {
  std::optional<ColmapCamera> colmap = colmap_camera(camera.model);
  if (!colmap) return colmap;
  if (const Radtan* m = std::get_if<Radtan>(&camera.model); m && estimated) {
    colmap->model = find_colmap_model("RADIAL")->id;
    colmap->parameters = {m->fx, m->cx + kColmapPixelOrigin, m->cy + kColmapPixelOrigin, m->k1, m->k2};
  }
  colmap->width = camera.width;
  colmap->height = camera.height;
  return colmap;
}

bool same_but_for_rounding(const ColmapCamera& a, const ColmapCamera& b) {
  constexpr double kRounding = 1e-12;
  const auto same = [](double x, double y) { return std::abs(x - y) <= kRounding * std::abs(x); };
  return a.model == b.model && a.width == b.width && a.height == b.height &&
         std::ranges::equal(a.parameters, b.parameters, same);
}

// What a world becomes: an image for each camera of each of its key frames, with identifiers from 1. Made
// one at a time, since a whole model takes more memory than the reconstruction.
class WorldImages {
 public:
  explicit WorldImages(const Reconstruction& world) : world_(world), lens_ids_(world.lenses.size(), 0) {
    for (const Camera& camera : world.rig.cameras) add_camera(camera);
    if (world.lenses.empty()) per_frame_ = world.rig.cameras.size();
    for (const KeyFrame& keyframe : world.keyframes) {
      const PosedFrame& posed = world.frames[keyframe.frame];
      if (!posed.world_from_rig) continue;
      keyframes_.push_back(&keyframe);
      if (posed.lens < 0 || lens_ids_[posed.lens] > 0) continue;
      lens_ids_[posed.lens] = id_of(world.lenses[posed.lens].camera);
    }
  }

  size_t size() const { return keyframes_.size() * per_frame_; }
  const Reconstruction& world() const { return world_; }
  bool estimated() const { return world_.origin == Origin::kSolve; }  // the lenses
  // Those of the rig, or the lenses of the key frames; nullopt where COLMAP has no such model.
  const std::optional<std::vector<ColmapCamera>>& cameras() const { return cameras_; }
  const Camera& camera(size_t i) const {
    return camera_of(world_, frame(i), static_cast<int>(i % per_frame_));
  }

  ColmapImage image(size_t i) const {
    const PosedFrame& posed = frame(i);
    const Rigid3 world_from_cam =
        posed.lens >= 0 ? *posed.world_from_rig : *posed.world_from_rig * camera(i).rig_from_cam;
    const Rigid3 cam_from_world = world_from_cam.inverse();
    const Eigen::Quaterniond& q = cam_from_world.rotation;
    const Eigen::Vector3d& t = cam_from_world.translation;
    ColmapImage image;
    image.id = static_cast<uint32_t>(i + 1);
    image.rotation = {q.w(), q.x(), q.y(), q.z()};
    image.translation = {t.x(), t.y(), t.z()};
    image.camera_id = camera_id(i);
    image.name = per_frame_ == 1 ? posed.image_name : camera(i).name + "/" + posed.image_name;
    return image;
  }

  // Calls f(observation) for the keypoints of an image.
  template <typename F>
  void for_each_keypoint(size_t i, F f) const {
    const KeyFrame& keyframe = *keyframes_[i / per_frame_];
    for (int k = keyframe.first_observation; k < keyframe.last_observation; ++k) {
      const Observation& o = world_.observations[k];
      if (o.camera == static_cast<int>(i % per_frame_)) f(o);
    }
  }

 private:
  const PosedFrame& frame(size_t i) const { return world_.frames[keyframes_[i / per_frame_]->frame]; }
  uint32_t camera_id(size_t i) const {
    return frame(i).lens >= 0 ? lens_ids_[frame(i).lens] : static_cast<uint32_t>(i % per_frame_ + 1);
  }

  // Returns its identifier.
  uint32_t add_camera(const Camera& camera) {
    std::optional<ColmapCamera> colmap = colmap_camera_of(camera, estimated());
    if (!colmap) cameras_.reset();
    if (!cameras_) return 0;
    colmap->id = static_cast<uint32_t>(cameras_->size() + 1);
    return cameras_->emplace_back(*std::move(colmap)).id;
  }
  // Of a lens that is there already, or that is added.
  uint32_t id_of(const Camera& camera) {
    const std::optional<ColmapCamera> colmap = colmap_camera_of(camera, estimated());
    for (size_t i = 0; colmap && cameras_ && i < cameras_->size(); ++i) {
      if (same_but_for_rounding((*cameras_)[i], *colmap)) return (*cameras_)[i].id;
    }
    return add_camera(camera);
  }

  const Reconstruction& world_;
  size_t per_frame_ = 1;  // images
  std::optional<std::vector<ColmapCamera>> cameras_{std::in_place};
  std::vector<uint32_t> lens_ids_;  // by lens; 0: of no key frame
  std::vector<const KeyFrame*> keyframes_;
};

// Where each point of a range is seen, and its mean error.
class PointTracks {
 public:
  PointTracks(const WorldImages& images, size_t begin, size_t end)
      : begin_(begin), end_(end), first_(end - begin + 1, 0), errors_(end - begin) {
    for (size_t i = 0; i < images.size(); ++i) {
      images.for_each_keypoint(i, [&](const Observation& o) {
        if (contains(o.point)) ++first_[o.point - begin_ + 1];
      });
    }
    std::partial_sum(first_.begin(), first_.end(), first_.begin());
    elements_.resize(first_.back());
    std::vector<uint32_t> next(first_.begin(), first_.end() - 1);
    for (size_t i = 0; i < images.size(); ++i) add(images, i, &next);
  }

  bool contains(size_t point) const { return begin_ <= point && point < end_; }
  // Of image and keypoint.
  std::span<const std::pair<uint32_t, uint32_t>> elements(size_t point) const {
    const size_t i = point - begin_;
    return std::span(elements_).subspan(first_[i], first_[i + 1] - first_[i]);
  }
  double mean_error(size_t point) const {
    const Error& error = errors_[point - begin_];
    return error.count > 0 ? error.sum / error.count : -1.0;
  }

 private:
  struct Error {
    double sum = 0;  // pixels
    int count = 0;
  };

  void add(const WorldImages& images, size_t i, std::vector<uint32_t>* next) {
    const ColmapImage image = images.image(i);
    const Rigid3 cam_from_world = colmap_pose(image);
    uint32_t keypoint = 0;
    images.for_each_keypoint(i, [&](const Observation& o) {
      const uint32_t number = keypoint++;
      if (!contains(o.point)) return;
      elements_[(*next)[o.point - begin_]++] = {image.id, number};
      // An estimated lens has a skew, which COLMAP's cameras have not: their errors are not its errors.
      if (images.estimated()) return;
      Eigen::Vector2d pixel;
      const Eigen::Vector3d& position = images.world().points[o.point].position;
      if (!images.camera(i).project(cam_from_world * position, &pixel)) return;
      Error& error = errors_[o.point - begin_];
      error.sum += (pixel - o.pixel).norm();
      ++error.count;
    });
  }

  size_t begin_, end_;
  std::vector<uint32_t> first_;  // element of each point
  std::vector<std::pair<uint32_t, uint32_t>> elements_;
  std::vector<Error> errors_;
};

// A file of `count` records. append(i, bytes) makes that of element i < end, or none.
template <typename Append>
Result<void> write_records(const std::filesystem::path& path, uint64_t count, size_t end, Append append) {
  constexpr size_t kPartBytes = 1 << 20;
  std::string part;
  size_t next = 0;
  return write_file(path, [&, begun = false]() mutable -> std::string_view {
    part.clear();
    if (!std::exchange(begun, true)) append_little_endian(part, count);
    while (next < end && part.size() < kPartBytes) append(next++, &part);
    return part;
  });
}

Result<void> write_images(const WorldImages& images, const std::filesystem::path& path) {
  std::vector<ColmapKeypoint> keypoints;
  return write_records(path, images.size(), images.size(), [&](size_t i, std::string* bytes) {
    keypoints.clear();
    images.for_each_keypoint(i, [&](const Observation& o) {
      keypoints.push_back({o.pixel.x() + kColmapPixelOrigin, o.pixel.y() + kColmapPixelOrigin,
                           static_cast<uint64_t>(o.point + 1)});
    });
    append_colmap_image_bin(images.image(i), keypoints, bytes);
  });
}

size_t count_seen(const WorldImages& images) {
  std::vector<bool> seen(images.world().points.size(), false);
  for (size_t i = 0; i < images.size(); ++i) {
    images.for_each_keypoint(i, [&](const Observation& o) { seen[o.point] = true; });
  }
  return std::ranges::count(seen, true);
}

// The points that are seen, with the tracks of a part of them at a time.
Result<void> write_points(const WorldImages& images, const std::filesystem::path& path) {
  constexpr size_t kPointsAtATime = 1 << 16;
  const std::vector<MapPoint>& points = images.world().points;
  std::optional<PointTracks> tracks;
  std::vector<ColmapTrackElement> elements;
  return write_records(path, count_seen(images), points.size(), [&](size_t p, std::string* bytes) {
    if (!tracks || !tracks->contains(p)) {
      tracks.reset();
      tracks.emplace(images, p, std::min(p + kPointsAtATime, points.size()));
    }
    elements.clear();
    for (const auto& [image, keypoint] : tracks->elements(p)) elements.push_back({image, keypoint});
    if (elements.empty()) return;
    append_colmap_point_bin({p + 1, points[p].position, points[p].rgb, tracks->mean_error(p)}, elements,
                            bytes);
  });
}

}  // namespace

Result<void> write_colmap_model(const Reconstruction& world, const std::filesystem::path& folder) {
  const WorldImages images(world);
  if (!images.cameras()) return {};
  ColmapModel model;
  model.cameras = *images.cameras();
  Result<void> written = create_folder(folder);
  if (written) written = write_file(folder / "cameras.bin", format_colmap_cameras_bin(model));
  if (written) written = write_images(images, folder / "images.bin");
  if (written) written = write_points(images, folder / "points3D.bin");
  return written;
}

}  // namespace raysfm
