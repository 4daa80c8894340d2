#include "raysfm/api/known_camera.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "raysfm/api/solve_result.h"
#include "raysfm/camera/camera_class.h"
#include "raysfm/camera_files/camera_file.h"
#include "raysfm/core/thread_pool.h"
#include "raysfm/ray_lenses/ray_reconstruction.h"
#include "raysfm/robust/absolute_pose.h"

namespace raysfm {
namespace {

Error refused(const SolveSettings& settings, const std::string& why) {
  return bad_input(fmt::format("{}: {}; raysfm track takes a video of it", settings.camera, why));
}

// What a camera's inliers say of its pose, points held; zero where that is nothing.
Matrix6d covariance_of(const RayReconstruction& found, const PointTracks& tracks,
                       const std::vector<int>& inliers, int image, PoseEstimator* estimator) {
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector2d> pixels;
  for (const int k : inliers) {
    points.push_back(found.points[tracks.point[k]]);
    pixels.push_back(tracks.pixel[k]);
  }
  PoseEstimate estimate;
  estimate.rig_from_world = found.cam_from_world[image];
  estimate.inlier.assign(points.size(), 1);
  estimator->refine(Rig{{found.camera}}, {.points_in_world = points, .pixels = pixels}, {}, &estimate);
  return estimate.ok() ? estimate.covariance : Matrix6d::Zero();
}

class KnownCameraResult {
 public:
  KnownCameraResult(const SolveInput& input, const RayReconstruction& found) : input_(input), found_(found) {
    const auto first = std::ranges::find(found.image_posed, 1);
    found_from_world_ = found.cam_from_world[first - found.image_posed.begin()].inverse();
    seen_.resize(input.names.size());
    inliers_.resize(input.names.size());
    for (int k = 0; k < input.tracks.size(); ++k) {
      seen_[input.tracks.image[k]] += found.point_placed[input.tracks.point[k]];
      if (found.inlier[k]) inliers_[input.tracks.image[k]].push_back(k);
    }
  }

  Reconstruction make(bool interrupted) {
    r_.origin = Origin::kTrack;
    r_.rig = Rig{{found_.camera}};
    add_frames();
    add_map();
    const auto has_pose = [](const PosedFrame& frame) { return frame.world_from_rig.has_value(); };
    const auto first = std::ranges::find_if(r_.frames, has_pose) - r_.frames.begin();
    const auto end = std::find_if(r_.frames.rbegin(), r_.frames.rend(), has_pose).base() - r_.frames.begin();
    r_.segments.push_back({static_cast<int>(first),
                           static_cast<int>(end) - 1,
                           interrupted ? "interrupted" : "end of input",
                           false,
                           {}});
    r_.starts.push_back(
        {"three views", {found_.start_images.begin(), found_.start_images.end()}, found_.start_inliers});
    return std::move(r_);
  }

 private:
  void add_frames() {
    PoseEstimator estimator;
    for (size_t j = 0; j < input_.names.size(); ++j) {
      PosedFrame& frame = r_.frames.emplace_back();
      frame.timestamp = input_.timestamps[j];
      frame.image_name = input_.names[j];
      if (!found_.image_posed[j]) {
        const bool defective = !input_.defects.empty() && !input_.defects[j].empty();
        frame.reason = defective ? input_.defects[j]
                                 : fmt::format(
                                       "too few of the {} points of the map that it shows agree with a "
                                       "pose",
                                       seen_[j]);
        continue;
      }
      const int image = static_cast<int>(j);
      const Rigid3 cam_from_world = found_.cam_from_world[j] * found_from_world_;
      frame.segment = 0;
      frame.world_from_rig = cam_from_world.inverse();
      frame.covariance = covariance_in_world(
          cam_from_world, covariance_of(found_, input_.tracks, inliers_[j], image, &estimator));
    }
  }

  void add_map() {
    std::vector<int> number(found_.point_placed.size(), -1);
    for (size_t i = 0; i < number.size(); ++i) {
      if (!found_.point_placed[i]) continue;
      number[i] = static_cast<int>(r_.points.size());
      MapPoint& point = r_.points.emplace_back();
      point.position = found_from_world_.inverse() * found_.points[i];
      if (!input_.rgb.empty()) point.rgb = input_.rgb[i];
    }
    double squares = 0;
    for (size_t j = 0; j < inliers_.size(); ++j) {
      if (!found_.image_posed[j]) continue;
      const auto first = static_cast<int>(r_.observations.size());
      for (const int k : inliers_[j]) {
        Eigen::Vector2d residual;
        if (!pixel_residual(input_.tracks, found_, k, &residual)) continue;
        squares += residual.squaredNorm();
        r_.observations.push_back({number[input_.tracks.point[k]], 0, input_.tracks.pixel[k]});
      }
      r_.keyframes.push_back({static_cast<int>(j), first, static_cast<int>(r_.observations.size())});
    }
    r_.rms_reprojection_px =
        std::sqrt(squares / std::max<double>(1, static_cast<double>(r_.observations.size())));
  }

  const SolveInput& input_;
  const RayReconstruction& found_;
  Rigid3 found_from_world_;
  std::vector<int> seen_;                  // by image: observations of placed points
  std::vector<std::vector<int>> inliers_;  // by image
  Reconstruction r_;
};

}  // namespace

Result<Camera> known_camera(const SolveSettings& settings, const Input* opened, const EventSink& event) {
  std::string note;
  Result<Rig> rig = read_camera_file(settings.camera, &note);
  if (!rig) return rig.error();
  tell(event, Event::Level::kWarning, note);
  if (rig->cameras.size() != 1) return refused(settings, fmt::format("{} cameras", rig->cameras.size()));
  if (opened) {
    rig = rig_for_streams(*std::move(rig), opened->streams, &note, true);
    if (!rig) return bad_input(fmt::format("{}: {}", settings.camera, rig.error().message));
  }
  Camera camera = rig->cameras[0];
  camera.rig_from_cam = Rigid3{};
  camera.shutter = {};
  if (camera.roi.w > 0) return refused(settings, "roi: the camera is a part of the image");
  if (!camera.mask_path.empty()) {
    tell(event, Event::Level::kWarning, fmt::format("{}: the mask is not used", settings.camera));
  }
  if (!camera.can_project()) return refused(settings, "the model cannot project");
  if (camera_class(Rig{{camera}}) != CameraClass::kCentral) return refused(settings, "no single viewpoint");
  return camera;
}

Result<SolveResult> solve_with_camera(const SolveInput& input, const SolveSettings& settings,
                                      const SolveCallbacks& callbacks) {
  const RayOptions options{.max_error_px = settings.max_error,
                           .is_known = true,
                           .in_order = false,
                           .seed = settings.seed,
                           .threads = thread_count(settings.threads),
                           .stopped = [&callbacks] { return callbacks.stopped(); }};
  const RayReconstruction found = reconstruct_along_rays(input.tracks, *input.camera, options);
  if (found.posed == 0) {
    return no_reconstruction(
        fmt::format("{}: no three of the {} images start a reconstruction: too few points in "
                    "common, or too little parallax",
                    settings.input, input.names.size()));
  }
  const bool interrupted = input.interrupted || callbacks.stopped();
  SolveResult result{KnownCameraResult(input, found).make(interrupted), {}};
  Report& report = result.report;
  report.seed = settings.seed;
  report.input = {settings.input};
  report.camera_class = "central";
  report.error = "pixel";
  report.stages = input.stages;
  report.interrupted = interrupted;
  report.lens_origin = LensOrigin{};
  result.reconstruction.range = settings.range;
  return result;
}

}  // namespace raysfm
