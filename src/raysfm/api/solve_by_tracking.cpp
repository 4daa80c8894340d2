#include "raysfm/api/solve_by_tracking.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "raysfm/api/find_lens.h"
#include "raysfm/api/solve_result.h"
#include "raysfm/api/track.h"
#include "raysfm/scene/worlds.h"

namespace raysfm {
namespace {

constexpr double kWorthIt = 1.1;      // times the frames with a pose
constexpr double kUsableFocal = 0.1;  // standard deviation of a focal length to track with, as a part of it
constexpr int kLeastFeatures = 50;    // that can be tracked

// The lens of all frames, and what solve_result() says of it.
SolveResult with_lens(TrackResult tracked, const SolveResult& solved) {
  SolveResult result{std::move(tracked.reconstruction), std::move(tracked.report)};
  Reconstruction& r = result.reconstruction;
  const FrameLens lens = solved.reconstruction.lenses.front();
  r.origin = Origin::kSolve;
  r.rig = {};
  r.calibration.clear();
  r.lenses = {lens};
  for (PosedFrame& frame : r.frames) frame.lens = frame.world_from_rig ? 0 : -1;
  go_on_from(solved.report, &result.report);
  return result;
}

}  // namespace

TrackSettings settings_of_tracking(const SolveSettings& settings) {
  TrackSettings tracking;
  tracking.inputs = {settings.input};
  tracking.fps = settings.fps;
  tracking.range = settings.range;
  tracking.mono = true;
  tracking.threads = settings.threads;
  tracking.refine_lens = "off";  // the adjustment of all that tells it has found it
  tracking.rolling_shutter = "none";
  tracking.odometry.features = std::max(kLeastFeatures, settings.features);
  tracking.odometry.seed = settings.seed;
  return tracking;
}

void go_on_from(const Report& solved, Report* tracked) {
  tracked->lens = solved.lens;
  tracked->adjustment = solved.adjustment;
  tracked->lens_origin.reset();
  tracked->stages.insert(tracked->stages.begin(), solved.stages.begin(), solved.stages.end());
}

Result<std::optional<SolveResult>> tracked_with_lens(const SolveInput& input,
                                                     const UncalibratedReconstruction& found,
                                                     const SolveSettings& settings,
                                                     const SolveCallbacks& callbacks) {
  const int posed = found.posed_count();
  if (found.zooming || !found.degenerate.empty() || found.lens_sigma.empty() || posed == 0) {
    return std::optional<SolveResult>();
  }
  const FoundLens lens = lens_of_stretch(found, input.tracks, 0, 1);
  if (!(lens.prior.focal <= kUsableFocal)) return std::optional<SolveResult>();
  tell(callbacks.event, Event::Level::kInfo,
       fmt::format("{} of {} frames have a pose; the whole video is tracked with the lens that they tell",
                   posed, input.names.size()));
  TrackCallbacks tracking;
  tracking.event = callbacks.event;
  tracking.stop = callbacks.stop;
  if (callbacks.progress) {
    tracking.progress = [&](const TrackProgress& p) { callbacks.progress("frame", p.frames, p.total); };
  }
  Result<TrackResult> tracked = track(settings_of_tracking(settings), tracking, nullptr, &lens);
  if (!tracked) return tracked.error();
  if (static_cast<double>(placed_count(tracked->reconstruction)) < kWorthIt * static_cast<double>(posed)) {
    return std::optional<SolveResult>();
  }
  return std::optional(with_lens(*std::move(tracked), solve_result(input, found, {}, settings, false)));
}

}  // namespace raysfm
