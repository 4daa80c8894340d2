#include "raysfm/exports/export_scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <set>
#include <utility>

#include "raysfm/files/staged_folder.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;

std::string folder_of(const Camera& camera, int index) {
  std::string name = camera.name.empty() ? fmt::format("cam{}", index) : camera.name;
  std::ranges::replace(name, '/', '_');
  return name == "." || name == ".." ? fmt::format("cam{}", index) : name;
}

std::string image_name(const Reconstruction& world, const PosedFrame& frame, int number, int camera) {
  std::string name = frame.image_name.empty() ? fmt::format("frame-{:06}", number) : frame.image_name;
  const bool several = frame.lens < 0 && world.rig.cameras.size() > 1;
  return several ? folder_of(world.rig.cameras[camera], camera) + "/" + name : name;
}

// Collects the images of one world.
class SceneMaker {
 public:
  explicit SceneMaker(const Reconstruction& world) : world_(world), camera_of_lens_(world.lenses.size(), -1) {
    scene_.rig = world.lenses.empty();
    if (scene_.rig) scene_.cameras = world.rig.cameras;
    scene_.skews.assign(scene_.cameras.size(), 0.0);
    scene_.points = world.points;
  }

  Result<void> add(int number, const KeyFrame* keyframe) {
    const PosedFrame& frame = world_.frames[number];
    if (!frame.world_from_rig) return {};
    const size_t first = scene_.images.size();
    const int cameras = frame.lens >= 0 ? 1 : static_cast<int>(world_.rig.cameras.size());
    if (cameras == 0) {
      return bad_input(
          fmt::format("image '{}': nothing tells its camera", image_name(world_, frame, number, 0)));
    }
    for (int c = 0; c < cameras; ++c) {
      ExportImage& image = scene_.images.emplace_back();
      image.frame = number;
      image.camera = frame.lens >= 0 ? camera_of_lens(frame.lens) : c;
      image.name = image_name(world_, frame, number, c);
      image.world_from_cam = *frame.world_from_rig * scene_.cameras[image.camera].rig_from_cam;
      if (!stays_below(image.name)) {
        return bad_input(
            fmt::format("image '{}': a name that leads out of its folder is not allowed", image.name));
      }
    }
    for (int k = keyframe ? keyframe->first_observation : 0; keyframe && k < keyframe->last_observation;
         ++k) {
      const Observation& o = world_.observations[k];
      if (o.camera < cameras) scene_.images[first + o.camera].keypoints.push_back({o.point, o.pixel});
    }
    return {};
  }

  ExportScene take() { return std::move(scene_); }

 private:
  int camera_of_lens(int lens) {
    int& camera = camera_of_lens_[lens];
    if (camera >= 0) return camera;
    camera = static_cast<int>(scene_.cameras.size());
    scene_.cameras.push_back(world_.lenses[lens].camera);
    scene_.skews.push_back(world_.lenses[lens].skew);
    return camera;
  }

  const Reconstruction& world_;
  std::vector<int> camera_of_lens_;  // -1: not used so far
  ExportScene scene_;
};

}  // namespace

Result<ExportScene> make_export_scene(const Reconstruction& world, bool all_frames) {
  SceneMaker maker(world);
  std::vector<const KeyFrame*> keyframes(world.frames.size(), nullptr);
  for (const KeyFrame& keyframe : world.keyframes) keyframes[keyframe.frame] = &keyframe;
  for (size_t f = 0; f < world.frames.size(); ++f) {
    if (!keyframes[f] && !all_frames) continue;
    if (auto added = maker.add(static_cast<int>(f), keyframes[f]); !added) return added.error();
  }
  return maker.take();
}

void name_as_png(ExportScene* scene) {
  std::set<std::string> names;
  for (const ExportImage& image : scene->images)
    names.insert(fs::path(image.name).replace_extension("").string());
  // "a.jpg" beside "a.bmp": both keep their endings before the new one.
  const bool unique = names.size() == scene->images.size();
  for (ExportImage& image : scene->images) {
    if (unique) {
      image.name = fs::path(image.name).replace_extension(".png").string();
    } else {
      image.name += ".png";
    }
  }
}

std::vector<double> point_errors(const ExportScene& scene) {
  std::vector<double> sums(scene.points.size(), 0.0);
  std::vector<int> counts(scene.points.size(), 0);
  for (const ExportImage& image : scene.images) {
    const Camera& camera = scene.cameras[image.camera];
    if (scene.skews[image.camera] != 0) continue;
    const Rigid3 cam_from_world = image.world_from_cam.inverse();
    for (const ExportKeypoint& k : image.keypoints) {
      Eigen::Vector2d pixel;
      if (!camera.project(cam_from_world * scene.points[k.point].position, &pixel)) continue;
      sums[k.point] += (pixel - k.pixel).norm();
      ++counts[k.point];
    }
  }
  for (size_t p = 0; p < sums.size(); ++p) sums[p] = counts[p] > 0 ? sums[p] / counts[p] : -1;
  return sums;
}

}  // namespace raysfm
