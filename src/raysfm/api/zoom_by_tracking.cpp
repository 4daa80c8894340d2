#include "raysfm/api/zoom_by_tracking.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "raysfm/api/find_lens.h"
#include "raysfm/api/solve_by_tracking.h"
#include "raysfm/api/track.h"
#include "raysfm/core/standard_deviation.h"
#include "raysfm/scene/frame_lens.h"
#include "raysfm/scene/worlds.h"
#include "raysfm/zoom/zoom_curve.h"

namespace raysfm {
namespace {

constexpr int kMostPasses = 6;
// Of the focal lengths, as a part of them: the change by a pass after which the next would tell nothing, and
// the least by any where they have not settled.
constexpr double kSettled = 0.001, kMostUnsettled = 0.02;
// Nor do they settle where the third pass changes them by more.
constexpr int kEarlyPasses = 3;
constexpr double kMostEarly = 0.04;
// Nor do they change at all where a pass finds a standard deviation below this: of zooms by 1.2 to 2 the
// first pass finds 0.068 to 0.27, and at least half of what the last does.
constexpr double kNoZoom = 0.01;
constexpr double kFocalPrior = 0.05;  // standard deviation of the one focal length on the canvas, as a part

// What all frames' lenses have in common.
struct CommonLens {
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();  // beside the middle of the image, in focal lengths
  double aspect = 1;                                 // fy / fx
  RadialDistortion radial = {};
  // As if the canvas had its readout in every frame: so it is where a camera enlarges a part of its picture
  // itself, whose rows take less time in all.
  RollingShutter shutter = {};
};

// None of other models.
std::optional<CommonLens> common_lens(const Camera& camera) {
  const std::optional<Lens> lens = lens_of(camera);
  if (!lens) return std::nullopt;
  return CommonLens{
      {(lens->cx - 0.5 * (camera.width - 1)) / lens->fx, (lens->cy - 0.5 * (camera.height - 1)) / lens->fx},
      lens->fy / lens->fx,
      radial_distortion_of(camera),
      camera.shutter};
}

// As it was given, but for its shutter: what a map of one lens refines through a zoom is bent by that.
std::optional<CommonLens> given_lens(const Reconstruction& tracked) {
  const Camera& refined = tracked.rig.cameras[0];
  std::optional<Lens> lens = lens_of(refined);
  if (!lens) return std::nullopt;
  RadialDistortion radial = radial_distortion_of(refined);
  for (const CalibrationNumber& n : tracked.calibration) {
    for (const auto& [name, value] : {std::pair{"fx", &lens->fx},
                                      {"fy", &lens->fy},
                                      {"cx", &lens->cx},
                                      {"cy", &lens->cy},
                                      {"k1", &radial.k1},
                                      {"k2", &radial.k2}}) {
      if (n.name == name) *value = n.given;
    }
  }
  Camera given = frame_lens(*lens, radial).camera;
  given.width = refined.width;
  given.height = refined.height;
  given.shutter = refined.shutter;
  return common_lens(given);
}

FoundLens lens_on_canvas(const UndoneZoom& zoom, const CommonLens& common) {
  const Lens lens{zoom.focal, common.aspect * zoom.focal,
                  0.5 * (zoom.width - 1) + common.centre.x() * zoom.focal,
                  0.5 * (zoom.height - 1) + common.centre.y() * zoom.focal, 0};
  FoundLens found{Rig{{frame_lens(lens, common.radial).camera}}, {}, {}};
  Camera& camera = found.rig.cameras[0];
  camera.name = "camera";
  camera.width = zoom.width;
  camera.height = zoom.height;
  camera.shutter = common.shutter;
  if (camera.shutter.readout > 0) found.prior.readout = kUsualReadout;
  found.prior.focal = kFocalPrior;
  found.origin = {.source = "footage", .focal = zoom.focal, .focal_sigma = kFocalPrior};
  found.told_apart = true;
  found.zoom = zoom;
  return found;
}

// One pass: the video tracked with these focal lengths.
struct Pass {
  UndoneZoom zoom;
  TrackResult tracked;
  std::vector<FocalMeasurement> measured;

  const Camera& canvas() const { return tracked.reconstruction.rig.cameras[0]; }
};

std::optional<Pass> track_canvas(const TrackSettings& settings, const TrackCallbacks& callbacks,
                                 const FoundLens& lens) {
  Result<TrackResult> tracked = track(settings, callbacks, nullptr, &lens);
  if (!tracked || tracked->reconstruction.frames.size() != lens.zoom.focals.size()) return std::nullopt;
  std::vector<FocalMeasurement> measured = measure_focals(tracked->reconstruction, lens.zoom);
  if (measured.empty()) return std::nullopt;
  return Pass{lens.zoom, *std::move(tracked), std::move(measured)};
}

double rms_between(std::span<const double> a, std::span<const double> b) {
  double squares = 0;
  for (size_t i = 0; i < a.size(); ++i) squares += std::pow(a[i] - b[i], 2);
  return std::sqrt(squares / static_cast<double>(a.size()));
}

// The pass with the least change. None where the focal lengths do not settle.
std::optional<Pass> settle(const ZoomCurve& curve, CommonLens common, const Eigen::Vector2i& size,
                           const TrackSettings& settings, const TrackCallbacks& callbacks) {
  TrackCallbacks quiet;
  quiet.stop = callbacks.stop;
  std::vector<double> log_focals = curve.log_focals({});
  std::optional<Pass> best;
  double least = std::numeric_limits<double>::infinity();
  for (int k = 0; k < kMostPasses && least > kSettled && !callbacks.stopped(); ++k) {
    const UndoneZoom zoom = undo_zoom(log_focals, size.x(), size.y());
    std::optional<Pass> pass = track_canvas(settings, quiet, lens_on_canvas(zoom, common));
    if (!pass) return std::nullopt;
    common = *common_lens(pass->canvas());
    const std::vector<double> before = std::exchange(log_focals, curve.log_focals(pass->measured));
    const double change = rms_between(before, log_focals);
    tell(callbacks.event, Event::Level::kInfo,
         fmt::format("tracked with the zoom undone: {} frames, focal lengths change by {:.2f} %",
                     placed_count(pass->tracked.reconstruction), 100 * change));
    if (k + 1 >= kEarlyPasses && change > kMostEarly) return std::nullopt;
    if (change < least) least = change, best = std::move(pass);
    if (standard_deviation(log_focals) < kNoZoom) break;
  }
  if (least > kMostUnsettled) best.reset();
  return best;
}

// Standard deviation of what all focal lengths have in common, as a part of them: as the tracker knows the
// one on the canvas, from what errors of neighbouring points and of an image share.
double common_sigma(const Reconstruction& tracked) {
  for (const CalibrationNumber& number : tracked.calibration) {
    if (number.name == "fx") return number.sigma / number.refined;
  }
  return 0;
}

// The lens of a frame of which the canvas has a larger or smaller picture.
FrameLens lens_of_frame(const Camera& canvas, const CanvasPlace& place, const Eigen::Vector2i& size,
                        double sigma) {
  const Lens on_canvas = *lens_of(canvas);
  const Lens lens{on_canvas.fx / place.scale, on_canvas.fy / place.scale,
                  place.back(on_canvas.cx, size.x(), place.width),
                  place.back(on_canvas.cy, size.y(), place.height), 0};
  FrameLens made = frame_lens(lens, radial_distortion_of(canvas));
  made.camera.width = size.x();
  made.camera.height = size.y();
  made.sigma[0] = made.sigma[1] = sigma * lens.fx;
  return made;
}

// What a pass tracked, from the canvas to the images as they were taken.
TrackResult off_canvas(Pass pass, const Eigen::Vector2i& size) {
  const Camera canvas = pass.canvas();
  TrackResult result = std::move(pass.tracked);
  Reconstruction* r = &result.reconstruction;
  double squares = 0;
  for (const KeyFrame& k : r->keyframes) {
    const CanvasPlace place = pass.zoom.place(k.frame);
    for (int o = k.first_observation; o < k.last_observation; ++o) {
      Eigen::Vector2d& pixel = r->observations[o].pixel;
      pixel = {place.back(pixel.x(), size.x(), place.width), place.back(pixel.y(), size.y(), place.height)};
      squares += 1 / (place.scale * place.scale);
    }
  }
  // As if all images were equally exact on the canvas.
  if (!r->observations.empty())
    r->rms_reprojection_px *= std::sqrt(squares / static_cast<double>(r->observations.size()));
  const double common = common_sigma(*r);
  auto measured = pass.measured.begin();  // the last until a frame
  for (int f = 0; f < static_cast<int>(r->frames.size()); ++f) {
    if (!r->frames[f].world_from_rig) continue;
    while (measured + 1 != pass.measured.end() && (measured + 1)->frame <= f) ++measured;
    r->frames[f].lens = static_cast<int>(r->lenses.size());
    r->lenses.push_back(lens_of_frame(canvas, pass.zoom.place(f), size, std::hypot(measured->sigma, common)));
  }
  r->origin = Origin::kSolve;
  r->rig = {};
  r->calibration.clear();
  result.report.lens = {
      .zooming = true,
      .evidence = fmt::format("the focal lengths of {} key frames, by the map of all", pass.measured.size()),
      .width = size.x(),
      .height = size.y(),
      .zoom_undone = true};
  result.report.lens_origin.reset();
  return result;
}

std::optional<TrackResult> undone(const ZoomCurve& curve, const CommonLens& common,
                                  const Eigen::Vector2i& size, const TrackSettings& settings,
                                  const TrackCallbacks& callbacks) {
  std::optional<Pass> pass = settle(curve, common, size, settings, callbacks);
  if (!pass) return std::nullopt;
  return off_canvas(*std::move(pass), size);
}

}  // namespace

std::optional<SolveResult> tracked_through_zoom(const SolveResult& solved, const SolveSettings& settings,
                                                const SolveCallbacks& callbacks) {
  const Reconstruction& before = solved.reconstruction;
  if (before.lenses.empty()) return std::nullopt;
  const Camera& camera = before.lenses[0].camera;
  TrackSettings tracking = settings_of_tracking(settings);
  tracking.refine_lens = "auto";
  tracking.rolling_shutter = "auto";
  TrackCallbacks callbacks_of_tracking;
  callbacks_of_tracking.event = callbacks.event;
  callbacks_of_tracking.stop = callbacks.stop;
  const ZoomCurve curve(static_cast<int>(before.frames.size()), focals_of(before));
  std::optional<TrackResult> tracked =
      undone(curve, {}, {camera.width, camera.height}, tracking, callbacks_of_tracking);
  if (!tracked || placed_count(tracked->reconstruction) < placed_count(before)) return std::nullopt;
  SolveResult result{std::move(tracked->reconstruction), std::move(tracked->report)};
  go_on_from(solved.report, &result.report);
  result.report.lens->zoom_undone = true;
  return result;
}

std::optional<TrackResult> tracked_through_zoom(const TrackResult& tracked, const TrackSettings& settings,
                                                const TrackCallbacks& callbacks) {
  const Reconstruction& r = tracked.reconstruction;
  const Camera& camera = r.rig.cameras[0];
  const std::optional<CommonLens> common = given_lens(r);
  // A mask, or a part of a picture, is of the images as they were taken.
  if (!common || camera.roi.w > 0 || !camera.mask_path.empty()) return std::nullopt;
  const UndoneZoom none{{1}, 1, camera.width, camera.height};
  const ZoomCurve curve(static_cast<int>(r.frames.size()), measure_focals(r, none));
  TrackSettings again = settings;
  again.checkpoint.clear();
  return undone(curve, *common, {camera.width, camera.height}, again, callbacks);
}

}  // namespace raysfm
