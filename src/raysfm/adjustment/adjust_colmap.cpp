#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "raysfm/adjustment/adjust_model.h"

namespace raysfm {
namespace {

// Images in the order of their names.
std::vector<int> images_by_name(const ColmapModel& model) {
  std::vector<int> order(model.images.size());
  std::iota(order.begin(), order.end(), 0);
  std::ranges::stable_sort(order, {}, [&](int i) -> const std::string& { return model.images[i].name; });
  return order;
}

Eigen::Vector2d pixel_of(const ColmapModel& model, const ColmapTrackElement& element) {
  const ColmapKeypoint& keypoint =
      model.keypoints[model.images[element.image].first_keypoint + element.keypoint];
  return {keypoint.x - kColmapPixelOrigin, keypoint.y - kColmapPixelOrigin};
}

// The cameras of all images that take part; the others stay empty.
Result<std::vector<Camera>> cameras_of(const ColmapModel& model, const AdjustSelection& selection,
                                       const std::filesystem::path& folder) {
  std::vector<Camera> cameras(model.cameras.size());
  std::vector<bool> done(model.cameras.size(), false);
  for (const int i : selection.images) {
    const int c = model.images[i].camera;
    if (done[c]) continue;
    const ColmapCamera& camera = model.cameras[c];
    Result<CameraModel> converted = camera_model_from_colmap(camera.model, camera.parameters);
    if (!converted) {
      return bad_input(fmt::format("{}: camera {}: {}", (folder / "cameras").string(), camera.id,
                                   converted.error().message));
    }
    cameras[c].model = *std::move(converted);
    done[c] = true;
  }
  return cameras;
}

// What the adjustment works on.
struct Arrays {
  std::vector<Camera> cameras;
  std::vector<Rigid3> cam_from_world;
  std::vector<Eigen::Vector3d> points;
  std::vector<BundleObservation> observations;

  BundleProblem problem() {
    BundleProblem problem;
    problem.cameras = cameras;
    problem.rig_from_world = cam_from_world;
    problem.points = points;
    problem.observations = observations;
    return problem;
  }
};

Arrays arrays_of(const ColmapModel& model, const AdjustSelection& selection, std::vector<Camera> cameras) {
  Arrays arrays;
  arrays.cameras = std::move(cameras);
  for (const int i : selection.images) arrays.cam_from_world.push_back(colmap_pose(model.images[i]));
  for (size_t p = 0; p < selection.points.size(); ++p) {
    const ColmapPoint& point = model.points[selection.points[p]];
    arrays.points.push_back(point.position);
    for (size_t e = point.first_element; e < point.last_element; ++e) {
      const ColmapTrackElement& element = model.elements[e];
      arrays.observations.push_back({selection.image_number[element.image], static_cast<int>(p),
                                     model.images[element.image].camera, pixel_of(model, element)});
    }
  }
  return arrays;
}

// Root mean square of the reprojection errors of the observations that project. With `mean_errors`, the mean
// error of each point as well; -1 where none projects.
double rms_of(const Arrays& arrays, std::vector<double>* mean_errors) {
  std::vector<double> sums(arrays.points.size(), 0);
  std::vector<int> counts(arrays.points.size(), 0);
  double sum = 0;
  int64_t count = 0;
  for (const BundleObservation& o : arrays.observations) {
    Eigen::Vector2d pixel;
    if (!arrays.cameras[o.camera].project(arrays.cam_from_world[o.pose] * arrays.points[o.point], &pixel))
      continue;
    const double squared = (pixel - o.pixel).squaredNorm();
    sum += squared;
    ++count;
    sums[o.point] += std::sqrt(squared);
    ++counts[o.point];
  }
  if (mean_errors) {
    for (size_t i = 0; i < sums.size(); ++i) sums[i] = counts[i] > 0 ? sums[i] / counts[i] : -1.0;
    *mean_errors = std::move(sums);
  }
  return count > 0 ? std::sqrt(sum / static_cast<double>(count)) : 0.0;
}

void write_back(const Arrays& arrays, const AdjustSelection& selection,
                const std::vector<double>& mean_errors, ColmapModel* model) {
  for (size_t i = 0; i < selection.images.size(); ++i) {
    ColmapImage& image = model->images[selection.images[i]];
    const Eigen::Quaterniond& q = arrays.cam_from_world[i].rotation;
    const Eigen::Vector3d& t = arrays.cam_from_world[i].translation;
    image.rotation = {q.w(), q.x(), q.y(), q.z()};
    image.translation = {t.x(), t.y(), t.z()};
  }
  for (size_t p = 0; p < selection.points.size(); ++p) {
    ColmapPoint& point = model->points[selection.points[p]];
    point.position = arrays.points[p];
    point.error = mean_errors[p];
  }
}

}  // namespace

Result<void> adjust_colmap_model(const AdjustTask& task, const std::filesystem::path& folder,
                                 ColmapModel* model, AdjustOutcome* outcome) {
  std::vector<SeenPoint> seen;
  seen.reserve(model->elements.size());
  for (size_t p = 0; p < model->points.size(); ++p) {
    for (size_t e = model->points[p].first_element; e < model->points[p].last_element; ++e) {
      seen.push_back({model->elements[e].image, static_cast<int>(p)});
    }
  }
  const AdjustSelection selection(seen, images_by_name(*model), static_cast<int>(model->points.size()));
  outcome->images = static_cast<int>(model->images.size());
  outcome->cameras = static_cast<int>(model->cameras.size());
  outcome->points = static_cast<int>(model->points.size());
  outcome->images_left_out = outcome->images - static_cast<int>(selection.images.size());
  outcome->points_left_out = outcome->points - static_cast<int>(selection.points.size());
  if (selection.points.empty()) return no_reconstruction("nothing to adjust, no point is seen by two images");
  Result<std::vector<Camera>> cameras = cameras_of(*model, selection, folder);
  if (!cameras) return cameras.error();
  if (auto r = task.ready(); !r) return r;

  Arrays arrays = arrays_of(*model, selection, *std::move(cameras));
  outcome->initial_rms_px = rms_of(arrays, nullptr);
  outcome->summary = adjust(arrays.problem(), task.method, task.options);
  if (keeps_start(outcome)) return {};
  std::vector<double> mean_errors;
  outcome->final_rms_px = rms_of(arrays, &mean_errors);
  write_back(arrays, selection, mean_errors, model);
  return {};
}

}  // namespace raysfm
