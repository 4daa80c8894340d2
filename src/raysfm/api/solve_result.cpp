#include "raysfm/api/solve_result.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "raysfm/api/solved_world.h"
#include "raysfm/plots/lens_plot.h"
#include "raysfm/results/lens_file.h"
#include "raysfm/results/output_folder.h"
#include "raysfm/results/world_writers.h"
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
  // Where all have one lens, also those that another world has.
  const int source = found.image_posed[image] ? image : found.first_posed();
  Lens lens = found.scene.lenses[source];
  lens.cx -= input.shift(image).x();
  lens.cy -= input.shift(image).y();
  FrameLens made = frame_lens(lens, found.radial);
  made.camera.width = size.x();
  made.camera.height = size.y();
  made.sigma = found.lens_sigma[source];
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

// Of the images that one reconstruction poses or another.
void place_lenses(const SolveInput& input, const UncalibratedReconstruction& found, Reconstruction* r) {
  for (size_t j = 0; j < r->frames.size(); ++j) {
    PosedFrame& frame = r->frames[j];
    if (frame.world_from_rig) frame.lens = place_lens(input, found, static_cast<int>(j), &r->lenses);
  }
}

void tell_why_without_pose(const SolveInput& input, const UncalibratedReconstruction& found,
                           Reconstruction* r) {
  std::vector<int> seen(input.names.size(), 0), agreeing(input.names.size(), 0);
  for (int k = 0; k < input.tracks.size(); ++k) {
    ++seen[input.tracks.image[k]];
    agreeing[input.tracks.image[k]] += found.inlier[k];
  }
  for (size_t j = 0; j < r->frames.size(); ++j) {
    PosedFrame& frame = r->frames[j];
    if (frame.world_from_rig) continue;
    const bool defective = !input.defects.empty() && !input.defects[j].empty();
    const int i = input.original(static_cast<int>(j));
    frame.reason = defective ? input.defects[j] : reason_without_pose(seen[i], agreeing[i]);
  }
}

void add_found(const SolveInput& input, const UncalibratedReconstruction& found, Reconstruction* r) {
  const auto of_images = pose_covariances(input.tracks, found);
  std::vector<Matrix6d> covariances(input.names.size());
  for (size_t j = 0; j < covariances.size(); ++j)
    covariances[j] = of_images[input.original(static_cast<int>(j))];
  add_world(
      input,
      {.cam_from_world = found.scene.cam_from_world,
       .covariances = covariances,
       .points = found.scene.points,
       .image_posed = found.image_posed,
       .point_placed = found.point_placed,
       .inlier = found.inlier,
       .rms_px = found.rms_px,
       .is_given = found.world_is_given,
       .start = {found.world_is_given ? "known structure" : "fundamental matrix and absolute dual quadric",
                 {found.start_images[0], found.start_images[1]},
                 found.start_inliers}},
      r);
}

Reconstruction solved_reconstruction(const SolveInput& input, UncalibratedReconstruction& found,
                                     std::span<const RayReconstruction> others, bool interrupted) {
  if (found.lens_sigma.size() != input.names.size()) {
    found.lens_sigma.assign(input.names.size(), LensVector::Constant(INFINITY));
  }
  Reconstruction r;
  r.origin = Origin::kSolve;
  r.metric_scale = found.world_is_given;
  r.frames = frames_of(input);
  add_found(input, found, &r);
  for (const RayReconstruction& other : others) add_world(input, other, &r);
  place_lenses(input, found, &r);
  tell_why_without_pose(input, found, &r);
  give_reasons(input, interrupted, &r);
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

// By the points of the main world.
void tell_why_without_pose(const SolveInput& input, const RayReconstruction& found, Reconstruction* r) {
  std::vector<int> seen(input.names.size(), 0);
  for (int k = 0; k < input.tracks.size(); ++k)
    seen[input.tracks.image[k]] += found.point_placed[input.tracks.point[k]];
  for (size_t j = 0; j < r->frames.size(); ++j) {
    PosedFrame& frame = r->frames[j];
    if (frame.world_from_rig) continue;
    const bool defective = !input.defects.empty() && !input.defects[j].empty();
    frame.reason = defective ? input.defects[j]
                             : fmt::format(
                                   "too few of the {} points of the map that it shows agree with a "
                                   "pose",
                                   seen[j]);
  }
}

Reconstruction known_reconstruction(const SolveInput& input, std::span<const RayReconstruction> worlds,
                                    bool interrupted) {
  Reconstruction r;
  r.origin = Origin::kTrack;
  r.rig = Rig{{worlds.front().camera}};
  r.frames = frames_of(input);
  for (const RayReconstruction& world : worlds) add_world(input, world, &r);
  tell_why_without_pose(input, worlds.front(), &r);
  give_reasons(input, interrupted, &r);
  return r;
}

}  // namespace

SolveResult solve_result(const SolveInput& input, UncalibratedReconstruction found,
                         std::span<const RayReconstruction> others, const SolveSettings& settings,
                         bool interrupted) {
  SolveResult result{solved_reconstruction(input, found, others, interrupted),
                     solve_report(input, found, settings)};
  result.reconstruction.range = settings.range;
  result.report.interrupted = interrupted;
  return result;
}

SolveResult solve_result(const SolveInput& input, std::span<const RayReconstruction> worlds,
                         const SolveSettings& settings, bool interrupted) {
  SolveResult result{known_reconstruction(input, worlds, interrupted), {}};
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
