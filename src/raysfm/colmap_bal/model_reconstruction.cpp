#include "raysfm/colmap_bal/model_reconstruction.h"

#include <numeric>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "raysfm/geometry/rotation.h"

namespace raysfm {
namespace {

// Adds an image as the next key frame, with the observations behind those of the one before, up to `last`.
void add_image(const Rigid3& world_from_cam, int lens, const std::string& name, size_t last,
               Reconstruction* r) {
  const int first = r->keyframes.empty() ? 0 : r->keyframes.back().last_observation;
  const auto number = static_cast<int>(r->frames.size());
  PosedFrame& frame = r->frames.emplace_back();
  frame.timestamp = number;
  frame.segment = 0;
  frame.world_from_rig = world_from_cam;
  frame.image_name = name;
  frame.lens = lens;
  r->keyframes.push_back({number, first, static_cast<int>(last)});
}

void add_world(Reconstruction* r) {
  r->origin = Origin::kAdjust;
  r->segments.push_back({0, static_cast<int>(r->frames.size()) - 1, "end of input", false, {}});
}

// A camera of BAL looks along -z with y up: half a turn about x.
Rigid3 world_from_bal(const std::array<double, 9>& camera) {
  const Eigen::Quaterniond half_turn(0, 1, 0, 0);
  const Rigid3 bal_from_world{exp_so3({camera[0], camera[1], camera[2]}), {camera[3], camera[4], camera[5]}};
  return (Rigid3{half_turn, Eigen::Vector3d::Zero()} * bal_from_world).inverse();
}

FrameLens lens_of(const std::array<double, 9>& camera) {
  FrameLens lens;
  lens.camera.model = Radtan{camera[6], camera[6], 0, 0, camera[7], camera[8]};
  return lens;
}

}  // namespace

Reconstruction reconstruction_of(const BalFile& file) {
  Reconstruction r;
  for (const Eigen::Vector3d& position : file.points) r.points.push_back({.position = position});
  std::vector<size_t> next(file.cameras.size() + 1, 0);
  for (const BalObservation& o : file.observations) ++next[o.camera + 1];
  std::partial_sum(next.begin(), next.end(), next.begin());
  r.observations.resize(file.observations.size());
  for (const BalObservation& o : file.observations) {
    r.observations[next[o.camera]++] = {o.point, 0, {o.pixel.x(), -o.pixel.y()}};
  }
  // next[c] is now where the observations of camera c end.
  for (size_t c = 0; c < file.cameras.size(); ++c) {
    r.lenses.push_back(lens_of(file.cameras[c]));
    add_image(world_from_bal(file.cameras[c]), static_cast<int>(c), "", next[c], &r);
  }
  add_world(&r);
  return r;
}

Reconstruction reconstruction_of(const ColmapModel& model) {
  Reconstruction r;
  std::unordered_map<uint64_t, int> point_numbers;
  for (const ColmapPoint& point : model.points) {
    point_numbers[point.id] = static_cast<int>(r.points.size());
    r.points.push_back({.position = point.position, .rgb = point.rgb});
  }
  std::vector<int> lens_numbers;  // by camera
  for (const ColmapCamera& camera : model.cameras) {
    Result<CameraModel> converted = camera_model_from_colmap(camera.model, camera.parameters);
    lens_numbers.push_back(converted ? static_cast<int>(r.lenses.size()) : -1);
    if (!converted) continue;
    Camera& lens = r.lenses.emplace_back().camera;
    lens.model = *std::move(converted);
    lens.width = static_cast<int>(camera.width);
    lens.height = static_cast<int>(camera.height);
  }
  for (const ColmapImage& image : model.images) {
    for (size_t k = image.first_keypoint; k < image.last_keypoint; ++k) {
      const ColmapKeypoint& seen = model.keypoints[k];
      if (seen.point_id == kNoColmapPoint) continue;
      r.observations.push_back(
          {point_numbers.at(seen.point_id), 0, {seen.x - kColmapPixelOrigin, seen.y - kColmapPixelOrigin}});
    }
    add_image(colmap_pose(image).inverse(), lens_numbers[image.camera], image.name, r.observations.size(),
              &r);
  }
  add_world(&r);
  return r;
}

}  // namespace raysfm
