#include "raysfm/api/track_zoom.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "raysfm/api/solve.h"
#include "raysfm/api/zoom_by_tracking.h"
#include "raysfm/core/median.h"
#include "raysfm/core/standard_deviation.h"
#include "raysfm/lenses/point_tracks.h"
#include "raysfm/scene/frame_lens.h"
#include "raysfm/scene/worlds.h"
#include "raysfm/uncalibrated/video_reconstruct.h"
#include "raysfm/zoom/map_stretch.h"

namespace raysfm {
namespace {

constexpr double kMostKeyframes = 200;
constexpr double kEnough = 0.7;  // of the frames that one lens poses
// By how much a lens for each image must lower the rms, and the focal length change, where no map of one lens
// is there to be better. Zooms by 1.1 and 1.2 of filmed footage lower the rms by less than 7 %, and then
// errors that are alike along tracks may bend the lenses more than one lens bends the path.
constexpr double kLeastGain = 1.1, kLeastSpread = 0.03;
// By how many of their standard deviations the focal lengths of a video that was tracked with the zoom undone
// must change, and by kLeastSpread.
constexpr double kSurelyChanges = 2;
// Longest focal length over the shortest: no camera zooms farther in a film, and a hand that turned far on
// the spot before a rolling shutter was solved with 30 to 9188 pixels.
constexpr double kMostZoom = 30;
// Key frames of a map that are looked at together, from one such stretch to the next, and at least: a hand
// that stays about one place makes few. With 5 as with 10 none of 120 pieces of real footage that does not
// zoom, of 20 to 80 frames, looked as if it did.
constexpr size_t kWindow = 40, kStep = 20, kLeastWindow = 5;
constexpr size_t kMostPoints = 600;  // the longest tracks of a stretch

struct FocalRange {
  double least = std::numeric_limits<double>::infinity(), most = 0;
};

FocalRange focal_range(const Reconstruction& r) {
  FocalRange range;
  for (const FrameLens& lens : r.lenses) {
    const double focal = lens_of(lens)->fx;
    range.least = std::min(range.least, focal), range.most = std::max(range.most, focal);
  }
  return range;
}

// Whether the focal lengths change by more than they are uncertain.
bool surely_changes(const Reconstruction& r) {
  std::vector<double> logs, sigmas;
  for (const FrameLens& lens : r.lenses) {
    const double focal = lens_of(lens)->fx;
    logs.push_back(std::log(focal));
    sigmas.push_back(lens.sigma[0] / focal);
  }
  return standard_deviation(logs) > std::max(kLeastSpread, kSurelyChanges * median_of(&sigmas));
}

// Whether the focal lengths of a video that was tracked with the zoom undone are all the same.
bool has_one_lens(const Reconstruction& r) {
  const FocalRange range = focal_range(r);
  return range.most < (1 + kLeastSpread) * range.least;
}

}  // namespace

bool can_have_lenses(const TrackSettings& settings) {
  return settings.inputs.size() == 1 && settings.map.empty() && settings.save_map.empty();
}

bool can_be_solved(const TrackSettings& settings, double keyframes) {
  return keyframes <= kMostKeyframes && can_have_lenses(settings);
}

std::optional<ZoomedStretch> zoom_in_map(const Reconstruction& r) {
  const Camera& camera = r.rig.cameras[0];
  const std::optional<Lens> lens = lens_of(camera);
  if (!lens) return std::nullopt;
  for (const std::vector<KeyFrame>& keyframes : keyframes_by_world(r)) {
    for (size_t first = 0; first + kLeastWindow <= keyframes.size(); first += kStep) {
      const size_t count = std::min(kWindow, keyframes.size() - first);
      const MapStretch s = stretch_of(r, *lens, std::span(keyframes).subspan(first, count), kMostPoints);
      const ZoomSigns signs = signs_of_zoom(s.tracks, std::vector<uint8_t>(s.tracks.image_count, 1), {},
                                            ErrorRelation::kAlongTracks, s.found);
      if (signs.zooms) {
        return ZoomedStretch{keyframes[first].frame, keyframes[first + count - 1].frame,
                             static_cast<double>(r.keyframes.size())};
      }
    }
  }
  return std::nullopt;
}

std::string zoom_warning(const std::optional<ZoomedStretch>& stretch) {
  if (!stretch) return {};
  return fmt::format(
      "frames {} to {} look as if the camera zoomed: poses are of one lens, raysfm solve finds a lens for "
      "each image",
      stretch->first_frame, stretch->last_frame);
}

bool is_clear_zoom(const TrackResult& solved) {
  const LensReport& lens = *solved.report.lens;
  return lens.gain == 0 || (lens.gain > kLeastGain && lens.spread > kLeastSpread);
}

bool reaches_enough(const TrackResult& solved, const Reconstruction& tracked) {
  const Reconstruction& r = solved.reconstruction;
  return posed_count(r) >= kEnough * posed_count(tracked) &&
         placed_count(r) >= kEnough * placed_count(tracked);
}

std::optional<TrackResult> solved_zoom(const TrackSettings& settings, const TrackCallbacks& callbacks) {
  SolveSettings of_solve;
  of_solve.input = settings.inputs[0];
  of_solve.images = "video";
  of_solve.fps = settings.fps;
  of_solve.range = settings.range;
  of_solve.threads = settings.threads;
  of_solve.seed = settings.odometry.seed;
  SolveCallbacks solving;
  solving.event = callbacks.event;
  solving.stop = callbacks.stop;
  Result<SolveResult> solved = solve(of_solve, solving);
  if (!solved) return {};
  if (!solved->report.lens->zooming || !solved->report.lens->degenerate.empty()) return {};
  const FocalRange focals = focal_range(solved->reconstruction);
  if (focals.most > kMostZoom * focals.least) return {};
  TrackResult result{std::move(solved->reconstruction), std::move(solved->report)};
  result.report.input = settings.inputs;
  return result;
}

std::optional<TrackResult> better_by_zoom(const TrackSettings& settings, const TrackCallbacks& callbacks,
                                          const TrackResult& tracked, ZoomRoute route) {
  const auto is_better = [&](const std::optional<TrackResult>& other) {
    return other && other->report.lens->zoom_undone && reaches_enough(*other, tracked.reconstruction) &&
           surely_changes(other->reconstruction);
  };
  std::optional<TrackResult> other;
  if (route == ZoomRoute::kSolveThenMap) other = solved_zoom(settings, callbacks);
  if (!is_better(other) && !callbacks.stopped()) other = tracked_through_zoom(tracked, settings, callbacks);
  const bool is_settled = other && has_one_lens(other->reconstruction);
  if (!is_better(other) && !is_settled && !callbacks.stopped() && route == ZoomRoute::kMapThenSolve)
    other = solved_zoom(settings, callbacks);
  return is_better(other) ? std::move(other) : std::nullopt;
}

std::string zoom_range(const TrackResult& result) {
  const FocalRange focals = focal_range(result.reconstruction);
  return fmt::format(
      "the camera zooms, its focal length is {:.0f} to {:.0f} px: {}, with a lens for each image",
      focals.least, focals.most,
      result.report.lens->zoom_undone ? "the video was tracked with the zoom undone"
                                      : "this is the result of raysfm solve");
}

}  // namespace raysfm
