#include "raysfm/io/colmap_file.h"

#include <string>
#include <vector>

#include "raysfm/io/colmap_model.h"

namespace raysfm {
namespace {

// The cameras, with identifiers from 1; false where COLMAP has no such model.
bool append_cameras(const Rig& rig, ColmapModel* model) {
  for (const Camera& camera : rig.cameras) {
    std::optional<ColmapCamera> colmap = colmap_camera(camera.model);
    if (!colmap) return false;
    colmap->id = static_cast<uint32_t>(model->cameras.size() + 1);
    colmap->width = camera.width;
    colmap->height = camera.height;
    model->cameras.push_back(*std::move(colmap));
  }
  return true;
}

// An image without keypoints, with the next identifier, counted from 1.
ColmapImage make_image(const Reconstruction& reconstruction, int frame, int camera, ColmapModel* model) {
  const Camera& seen_by = reconstruction.rig.cameras[camera];
  const PosedFrame& posed = reconstruction.frames[frame];
  const Rigid3 cam_from_world = (*posed.world_from_rig * seen_by.rig_from_cam).inverse();
  const Eigen::Quaterniond& q = cam_from_world.rotation;
  const Eigen::Vector3d& t = cam_from_world.translation;
  ColmapImage image;
  image.id = static_cast<uint32_t>(model->images.size() + 1);
  image.rotation = {q.w(), q.x(), q.y(), q.z()};
  image.translation = {t.x(), t.y(), t.z()};
  image.camera = camera;
  image.camera_id = model->cameras[camera].id;
  image.name =
      reconstruction.rig.cameras.size() == 1 ? posed.image_name : seen_by.name + "/" + posed.image_name;
  image.first_keypoint = image.last_keypoint = model->keypoints.size();
  return image;
}

// One image for each camera of each key frame; `seen[i]` becomes the observation that
// keypoint i of the model is.
void append_images(const Reconstruction& reconstruction, ColmapModel* model, std::vector<int>* seen) {
  for (const KeyFrame& keyframe : reconstruction.keyframes) {
    const PosedFrame& frame = reconstruction.frames[keyframe.frame];
    if (!frame.world_from_rig) continue;
    for (int c = 0; c < static_cast<int>(reconstruction.rig.cameras.size()); ++c) {
      ColmapImage image = make_image(reconstruction, keyframe.frame, c, model);
      for (int i = keyframe.first_observation; i < keyframe.last_observation; ++i) {
        const Observation& o = reconstruction.observations[i];
        if (o.camera != c) continue;
        model->keypoints.push_back({o.pixel.x() + kColmapPixelOrigin, o.pixel.y() + kColmapPixelOrigin,
                                    static_cast<uint64_t>(o.point + 1)});
        seen->push_back(i);
      }
      image.last_keypoint = model->keypoints.size();
      model->images.push_back(std::move(image));
    }
  }
}

// The track of every point that is seen, and its mean error.
void append_points(const Reconstruction& reconstruction, const std::vector<int>& seen, ColmapModel* model) {
  std::vector<std::vector<ColmapTrackElement>> tracks(reconstruction.points.size());
  std::vector<double> error_sums(tracks.size(), 0);
  std::vector<int> errors(tracks.size(), 0);
  for (size_t i = 0; i < model->images.size(); ++i) {
    const ColmapImage& image = model->images[i];
    const Camera& camera = reconstruction.rig.cameras[image.camera];
    const Rigid3 cam_from_world = colmap_pose(image);
    for (size_t k = image.first_keypoint; k < image.last_keypoint; ++k) {
      const Observation& o = reconstruction.observations[seen[k]];
      tracks[o.point].push_back(
          {image.id, static_cast<uint32_t>(k - image.first_keypoint), static_cast<int>(i)});
      Eigen::Vector2d pixel;
      if (!camera.project(cam_from_world * reconstruction.points[o.point].position, &pixel)) continue;
      error_sums[o.point] += (pixel - o.pixel).norm();
      ++errors[o.point];
    }
  }
  for (size_t p = 0; p < tracks.size(); ++p) {
    if (tracks[p].empty()) continue;
    const double error = errors[p] > 0 ? error_sums[p] / errors[p] : -1.0;
    const size_t first = model->elements.size();
    model->elements.insert(model->elements.end(), tracks[p].begin(), tracks[p].end());
    model->points.push_back({p + 1, reconstruction.points[p].position, reconstruction.points[p].rgb, error,
                             first, model->elements.size()});
  }
}

}  // namespace

Result<void> write_colmap_model(const Reconstruction& world, const std::filesystem::path& folder) {
  ColmapModel model;
  if (!append_cameras(world.rig, &model)) return {};
  std::vector<int> seen;
  append_images(world, &model, &seen);
  append_points(world, seen, &model);
  return write_colmap_model(model, folder);
}

}  // namespace raysfm
