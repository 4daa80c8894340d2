// What speaks against the lenses of a camera file.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "raysfm/api/given_lens.h"
#include "raysfm/features/octaves.h"
#include "raysfm/scene/frame_lens.h"
#include "raysfm/scene/worlds.h"
#include "raysfm/solving/solve_tracks.h"

namespace raysfm {
namespace {

// Factor by which standard deviations of corners are too small, about: the distortion is left out.
constexpr double kOptimistic = 2;
// What a map explains badly: observations that fit it are this far off, pixels; a camera has less than this
// part of the observations that others have; or fewer frames have a pose.
constexpr double kBadFit = 0.6, kFewFit = 0.25, kFewPosed = 0.5;
// Cameras do not see the same things where less than this part is common of so many points that should be.
constexpr double kFewCommon = 0.15;
constexpr int kEnoughCommon = 100;

// Views for a lens of corners; focal lengths as a part of the width, beyond which there is none; samples of
// each RANSAC: ten times as many find the same in twice the time.
constexpr int kLeastViews = 5, kSamples = 200;
constexpr double kLeastFocal = 0.15, kMostFocal = 10;
// Points of a camera that another one, whose view it shares, should see too, and those that it does.
struct Common {
  int expected = 0, seen = 0;
};

// Of the observations of one key frame. `in_camera`: a point in the frame of a camera.
template <typename InCamera>
void count_common(std::span<const Observation> observations, const TrackingRig& rig, InCamera in_camera,
                  std::vector<Common>* common) {
  if (rig.common_views().empty()) return;
  std::vector<std::pair<int, int>> seen;  // camera, point
  for (const Observation& o : observations) seen.emplace_back(o.camera, o.point);
  std::ranges::sort(seen);
  for (const auto& [a, b] : rig.common_views()) {
    for (const Observation& o : observations) {
      Eigen::Vector2d pixel;
      if (o.camera != a || !rig.see(b, in_camera(b, o.point), &pixel)) continue;
      ++(*common)[a].expected;
      (*common)[a].seen += std::ranges::binary_search(seen, std::pair(b, o.point));
    }
  }
}

// As the lens would show it without its distortion.
PointTracks without_distortion(const PointTracks& tracks, const Camera& camera, const Lens& lens) {
  PointTracks ideal = tracks;
  ideal.image.clear(), ideal.point.clear(), ideal.pixel.clear();
  for (int k = 0; k < tracks.size(); ++k) {
    Ray ray;
    if (camera.ray(tracks.pixel[k], &ray) && ray.direction.z() > 0)
      ideal.add(tracks.image[k], tracks.point[k], lens.pixel(ray.direction.hnormalized()));
  }
  return ideal;
}

}  // namespace

std::optional<CornerFocal> focal_of_corners(std::span<const ViewPtr> views, const Camera& camera, int number,
                                            uint64_t seed) {
  const std::optional<Lens> lens = lens_of(camera);
  if (!lens || std::ssize(views) < kLeastViews) return std::nullopt;
  PointTracks tracks = without_distortion(corner_tracks(views, number), camera, *lens);
  const double side = octave_side(views[0]->cameras[number].octaves->first());
  stretch_images(Eigen::Vector2d::Constant(1 / side), &tracks);
  SolveOptions options;
  options.lens = LensChange::kFixed;
  options.radial = RadialChoice::kNone;
  options.max_samples = kSamples;
  options.seed = seed;
  const auto found = reconstruct(tracks, options);
  if (!found || !found->degenerate.empty() || found->lens_sigma.empty()) return std::nullopt;
  const int image = found->first_posed();
  if (found->posed_count() < kLeastViews) return std::nullopt;
  const double focal = found->scene.lenses[image].fx, sigma = found->lens_sigma[image][0];
  const double width = tracks.image_size.x();
  if (!(focal > kLeastFocal * width && focal < kMostFocal * width) || !std::isfinite(sigma))
    return std::nullopt;
  return CornerFocal{focal * side, sigma / focal};
}

std::vector<CameraFit> fits_of_cameras(const Reconstruction& r, const TrackingRig& rig) {
  constexpr size_t kAsked = 64;  // key frames
  std::vector<CameraFit> fits(rig.size());
  std::vector<Common> common(rig.size());
  const size_t step = r.keyframes.size() / kAsked + 1;
  for (size_t k = 0; k < r.keyframes.size(); k += step) {
    const KeyFrame& keyframe = r.keyframes[k];
    const Rigid3 rig_from_world = r.frames[keyframe.frame].world_from_rig->inverse();
    const auto in_camera = [&](int c, int point) {
      return rig.cam_from_rig(c) * (rig_from_world * r.points[point].position);
    };
    const std::span seen =
        std::span(r.observations)
            .subspan(keyframe.first_observation, keyframe.last_observation - keyframe.first_observation);
    for (const Observation& o : seen) {
      Eigen::Vector2d pixel;
      if (!rig.find(o.camera, in_camera(o.camera, o.point), &pixel)) continue;
      fits[o.camera].rms += (pixel - o.pixel).squaredNorm();
      ++fits[o.camera].observations;
    }
    count_common(seen, rig, in_camera, &common);
  }
  double all = 0;
  for (CameraFit& fit : fits) {
    fit.rms = std::sqrt(fit.rms / std::max(1, fit.observations));
    all += fit.observations;
  }
  const bool is_lost = posed_count(r) < kFewPosed * static_cast<double>(r.frames.size());
  for (size_t c = 0; c < fits.size(); ++c) {
    CameraFit& fit = fits[c];
    const bool has_few = fit.observations < kFewFit * all / static_cast<double>(fits.size()) || all == 0;
    fit.is_bad = is_lost || has_few || fit.rms > kBadFit;
    fit.is_apart = common[c].expected >= kEnoughCommon && common[c].seen < kFewCommon * common[c].expected;
  }
  return fits;
}

bool tells_focals(const std::vector<CalibrationNumber>& calibration) {
  bool has = false, all = true;
  for (const CalibrationNumber& n : calibration) {
    if (n.name == "fx") has = true, all &= n.told;
  }
  return has && all;
}

std::vector<LensDoubt> doubts_of_lenses(const Reconstruction& r, std::span<const ViewPtr> keyframes,
                                        const TrackingRig& rig, const ViewMaker& maker, uint64_t seed) {
  std::vector<LensDoubt> doubts;
  std::vector<ViewPtr> views;
  const std::vector<CameraFit> fits = fits_of_cameras(r, rig);
  for (const CalibrationNumber& focal : r.calibration) {
    if (focal.name != "fx") continue;
    const int c = focal.camera;
    if (are_other_lenses(focal.refined, focal.given)) {
      doubts.push_back({c, LensDoubt::By::kMap, focal.given, focal.refined});
      continue;
    }
    if (fits[c].is_apart && (focal.told || !fits[c].is_bad)) {
      doubts.push_back({c, LensDoubt::By::kApart, focal.given, focal.given});
      continue;
    }
    // One camera alone may fit a wrong map; those of a rig hold each other.
    if (focal.told || (c > 0 && !fits[c].is_bad)) continue;
    for (size_t k = views.size(); k < keyframes.size(); ++k) views.push_back(maker.detected(keyframes[k]));
    const std::optional<CornerFocal> seen = focal_of_corners(views, r.rig.cameras[c], c, seed);
    if (seen && are_other_lenses(seen->focal, focal.refined, kOptimistic * seen->sigma)) {
      doubts.push_back({c, LensDoubt::By::kCorners, focal.given, seen->focal});
    } else if (!seen && fits[c].is_bad) {
      const double far_off = fits[c].rms > kBadFit ? fits[c].rms : 0;
      doubts.push_back({c, LensDoubt::By::kMisfit, focal.given, focal.given, far_off});
    }
  }
  return doubts;
}

}  // namespace raysfm
