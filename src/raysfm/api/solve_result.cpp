#include "raysfm/api/solve_result.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "raysfm/plots/lens_plot.h"
#include "raysfm/results/lens_file.h"
#include "raysfm/results/output_folder.h"
#include "raysfm/results/world_writers.h"
#include "raysfm/robust/absolute_pose.h"
#include "raysfm/uncalibrated/pose_covariance.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;

constexpr const char* kPlot = "lens.png";

std::string reason_without_pose(int seen, int agreeing) {
  if (seen < kMinPointsPerImage) {
    return fmt::format("too few tracks: {}, at least {} are needed", seen, kMinPointsPerImage);
  }
  return fmt::format("{} of {} tracks agree with a pose, at least {} are needed", agreeing, seen,
                     kMinPointsPerImage);
}

bool same_but_for_rounding(const LensVector& a, const LensVector& b) {
  constexpr double kRounding = 1e-12;
  for (int i = 0; i < a.size(); ++i) {
    if (a[i] != b[i] && !(std::abs(a[i] - b[i]) <= kRounding * std::abs(a[i]))) return false;
  }
  return true;
}

// The lens of an image, in an image of its own size.
FrameLens lens_of_image(const SolveInput& input, const UncalibratedReconstruction& found, int image) {
  const Eigen::Vector2i size =
      input.sizes.empty() ? input.tracks.image_size.cast<int>().eval() : input.sizes[image];
  Lens lens = found.scene.lenses[image];
  lens.cx -= input.shift(image).x();
  lens.cy -= input.shift(image).y();
  FrameLens made = frame_lens(lens, found.radial);
  made.camera.width = size.x();
  made.camera.height = size.y();
  made.sigma = found.lens_sigma[image];
  made.radial_sigma = found.radial_sigma;
  return made;
}

// The number of the lens of an image among `lenses`. One that does not zoom is that of all images that are of
// one size and tell it equally well.
int place_lens(const SolveInput& input, const UncalibratedReconstruction& found, int image,
               std::vector<FrameLens>* lenses) {
  FrameLens lens = lens_of_image(input, found, image);
  for (size_t i = 0; !found.zooming && i < lenses->size(); ++i) {
    const FrameLens& other = (*lenses)[i];
    if (other.camera.width == lens.camera.width && other.camera.height == lens.camera.height &&
        same_but_for_rounding(lens_of(other)->vector(), lens_of(lens)->vector()) &&
        same_but_for_rounding(other.sigma, lens.sigma)) {
      return static_cast<int>(i);
    }
  }
  lenses->push_back(std::move(lens));
  return static_cast<int>(lenses->size()) - 1;
}

void fill_frames(const SolveInput& input, const UncalibratedReconstruction& found,
                 const Rigid3& found_from_world, Reconstruction* r) {
  std::vector<int> seen(input.names.size(), 0), agreeing(input.names.size(), 0);
  for (int k = 0; k < input.tracks.size(); ++k) {
    ++seen[input.tracks.image[k]];
    agreeing[input.tracks.image[k]] += found.inlier[k];
  }
  const auto covariances = pose_covariances(input.tracks, found);
  for (size_t j = 0; j < input.names.size(); ++j) {
    PosedFrame& frame = r->frames.emplace_back();
    frame.timestamp = input.timestamps[j];
    frame.image_name = input.names[j];
    if (!found.image_posed[j]) {
      const bool defective = !input.defects.empty() && !input.defects[j].empty();
      const int i = input.original(static_cast<int>(j));
      frame.reason = defective ? input.defects[j] : reason_without_pose(seen[i], agreeing[i]);
      continue;
    }
    const Rigid3 cam_from_world = found.scene.cam_from_world[j] * found_from_world;
    frame.segment = 0;
    frame.world_from_rig = cam_from_world.inverse();
    // The upper triangle is what the file holds.
    frame.covariance = covariance_in_world(cam_from_world, covariances[input.original(static_cast<int>(j))])
                           .selfadjointView<Eigen::Upper>();
    frame.lens = place_lens(input, found, static_cast<int>(j), &r->lenses);
  }
}

// The points that have a place; returns the number of each among those of `r`, -1 for the others.
std::vector<int> add_points(const SolveInput& input, const std::vector<uint8_t>& placed,
                            const std::vector<Eigen::Vector3d>& points, const Rigid3& world_from_found,
                            Reconstruction* r) {
  std::vector<int> number(placed.size(), -1);
  for (size_t i = 0; i < number.size(); ++i) {
    if (!placed[i]) continue;
    number[i] = static_cast<int>(r->points.size());
    MapPoint& point = r->points.emplace_back();
    point.position = world_from_found * points[i];
    if (!input.rgb.empty()) point.rgb = input.rgb[i];
  }
  return number;
}

// The observations that agree, of key frames with a pose.
void fill_map(const SolveInput& input, const UncalibratedReconstruction& found,
              const Rigid3& world_from_found, Reconstruction* r) {
  const std::vector<int> number =
      add_points(input, found.point_placed, found.scene.points, world_from_found, r);
  std::vector<std::vector<Observation>> of_image(input.names.size());
  for (int k = 0; k < input.tracks.size(); ++k) {
    const int image = input.tracks.image[k];
    if (!found.inlier[k]) continue;
    of_image[image].push_back({number[input.tracks.point[k]], 0, input.tracks.pixel[k] - input.shift(image)});
  }
  for (int j = 0; j < static_cast<int>(of_image.size()); ++j) {
    if (!input.keyframe[j] || !found.image_posed[j]) continue;
    const auto first = static_cast<int>(r->observations.size());
    r->observations.insert(r->observations.end(), of_image[j].begin(), of_image[j].end());
    r->keyframes.push_back({j, first, static_cast<int>(r->observations.size())});
  }
}

// The one world, from the first pose to the last.
void fill_segment(const UncalibratedReconstruction& found, bool interrupted, Reconstruction* r) {
  const auto has_pose = [](const PosedFrame& frame) { return frame.world_from_rig.has_value(); };
  const auto first = std::ranges::find_if(r->frames, has_pose);
  if (first == r->frames.end()) return;
  const auto end = std::find_if(r->frames.rbegin(), r->frames.rend(), has_pose).base();
  const std::string last_reason = interrupted ? "interrupted" : "end of input";
  r->segments.push_back({static_cast<int>(first - r->frames.begin()),
                         static_cast<int>(end - r->frames.begin()) - 1,
                         end == r->frames.end() ? last_reason : end->reason,
                         found.world_is_given,
                         {}});
  r->starts.push_back(
      {found.world_is_given ? "known structure" : "fundamental matrix and absolute dual quadric",
       {found.start_images[0], found.start_images[1]},
       found.start_inliers});
}

Reconstruction solved_reconstruction(const SolveInput& input, UncalibratedReconstruction& found,
                                     bool interrupted) {
  if (found.lens_sigma.size() != input.names.size()) {
    found.lens_sigma.assign(input.names.size(), LensVector::Constant(INFINITY));
  }
  Reconstruction r;
  r.origin = Origin::kSolve;
  r.metric_scale = found.world_is_given;
  r.rms_reprojection_px = found.rms_px;
  const int first = found.first_posed();
  Rigid3 found_from_world;
  if (!found.world_is_given && first >= 0) found_from_world = found.scene.cam_from_world[first].inverse();
  fill_frames(input, found, found_from_world, &r);
  fill_map(input, found, found_from_world.inverse(), &r);
  fill_segment(found, interrupted, &r);
  return r;
}

Report solve_report(const SolveInput& input, const UncalibratedReconstruction& found,
                    const SolveSettings& settings) {
  const LmSummary& lm = found.adjustment.lm;
  Report report;
  report.seed = settings.seed;
  report.input = {settings.input};
  report.camera_class = "central";
  report.error = "pixel";
  report.stages = input.stages;
  report.stages.insert(report.stages.end(), found.stages.begin(), found.stages.end());
  report.lens = {found.zooming,
                 found.lens_evidence,
                 found.degenerate,
                 static_cast<int>(input.tracks.image_size.x()),
                 static_cast<int>(input.tracks.image_size.y()),
                 input.exif,
                 found.lens_gain,
                 found.lens_spread};
  report.adjustment = {.method = settings.method,
                       .initial_cost = lm.initial_cost,
                       .final_cost = lm.final_cost,
                       .iterations = lm.iterations,
                       .termination = std::string(to_string(lm.termination))};
  return report;
}

// What an image's inliers say of its pose, points held; zero where that is nothing.
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
    const std::vector<int> number =
        add_points(input_, found_.point_placed, found_.points, found_from_world_.inverse(), &r_);
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

SolveResult solve_result(const SolveInput& input, UncalibratedReconstruction found,
                         const SolveSettings& settings, bool interrupted) {
  SolveResult result{solved_reconstruction(input, found, interrupted), solve_report(input, found, settings)};
  result.reconstruction.range = settings.range;
  result.report.interrupted = interrupted;
  return result;
}

SolveResult solve_result(const SolveInput& input, const RayReconstruction& found,
                         const SolveSettings& settings, bool interrupted) {
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

std::vector<ResultFile> lens_plot(const Reconstruction& reconstruction) {
  std::vector<LensOfFrame> lenses = lenses_of_frames(reconstruction);
  if (lenses.empty()) return {};
  return {{kPlot, [lenses = std::move(lenses)](const fs::path& path) { return plot_lens(lenses, path); }}};
}

Result<void> check_solve_output(const fs::path& input, const fs::path& folder) {
  std::vector<std::string> inputs = {input.string()};
  // Files of a sequence are called as results are.
  for (const char* name : {kPlot, "config.yaml", "report.json"}) inputs.push_back((input / name).string());
  for (const WorldWriter& writer : world_writers()) inputs.push_back((input / writer.name).string());
  return check_output_folder(folder, inputs, std::vector<std::string>{kPlot});
}

Result<void> write_solve_output(const SolveResult& result, const SolveSettings& settings,
                                const std::string& version, const fs::path& folder) {
  SolveSettings effective = settings;
  Report report = result.report;
  report.version = version;
  const Result<bool> written =
      write_output_folder(result.reconstruction, std::move(report),
                          effective_config(setting_fields(effective), {settings.input}, version), folder,
                          lens_plot(result.reconstruction));
  return written ? Result<void>() : written.error();
}

}  // namespace raysfm
