// lens_by_tracking(): a lens that no stretch of the footage tells.
#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <string>
#include <vector>

#include "raysfm/api/find_lens.h"
#include "raysfm/scene/worlds.h"

namespace raysfm {
namespace {

// Focal lengths to begin with, in parts of the longer side of the image: of 76 and 50 degrees. From either,
// tracking finds lenses that are half as far again to both sides.
constexpr std::array kGuesses = {0.64, 1.07};
constexpr CalibrationPrior kGuessed{.focal = 0.2, .centre = 0.02, .rim = 0.05};
constexpr int kMostTracked = 900;
constexpr int kMostGuesses = 2;  // the second begins where the first ended
// By how much the two may end apart, as a part of the focal length; and what must have a pose.
constexpr double kAgree = 0.03, kMostlyPosed = 0.5;

// Ends a run after so many frames, or with the run that it is a part of.
class FrameLimit : public TrackWatcher {
 public:
  explicit FrameLimit(const TrackCallbacks& whole) : whole_(whole) {}
  void frame_done(const Tracker&) override { stop = ++frames_ >= kMostTracked || whole_.stopped(); }

  std::atomic<bool> stop = false;

 private:
  const TrackCallbacks& whole_;
  int frames_ = 0;
};

// The lens at which tracking from a guess ends, where its map tells it.
std::optional<FoundLens> refined_guess(const TrackSettings& settings, const TrackCallbacks& callbacks,
                                       const FoundLens& guess) {
  FrameLimit limit(callbacks);
  TrackCallbacks unheard;
  unheard.stop = &limit.stop;
  const Result<TrackResult> run = track(settings, unheard, &limit, &guess);
  if (!run || callbacks.stopped()) return std::nullopt;
  const Reconstruction& r = run->reconstruction;
  const auto focal = std::ranges::find(r.calibration, "fx", &CalibrationNumber::name);
  if (focal == r.calibration.end() || !focal->told) return std::nullopt;
  if (posed_count(r) < kMostlyPosed * static_cast<double>(r.frames.size())) return std::nullopt;
  FoundLens lens{r.rig.cameras[0], {}, {}};
  lens.camera.shutter = {};
  lens.origin = {.source = "footage",
                 .first_frame = 0,
                 .last_frame = static_cast<int>(r.frames.size()) - 1,
                 .focal = focal->refined,
                 .focal_sigma = focal->sigma / focal->refined};
  return lens;
}

// The one whose map is surest, where all say the same.
std::optional<FoundLens> agreement(const std::vector<FoundLens>& found) {
  const auto focal_sigma = [](const FoundLens& lens) { return lens.origin.focal_sigma; };
  FoundLens best = *std::ranges::min_element(found, {}, focal_sigma);
  for (const FoundLens& other : found) {
    const double apart = std::abs(std::log(other.origin.focal / best.origin.focal));
    if (apart > kAgree) return std::nullopt;
    best.origin.focal_sigma = std::max(best.origin.focal_sigma, apart);
  }
  best.prior.focal = std::max(best.prior.focal, best.origin.focal_sigma);
  return best;
}

}  // namespace

std::optional<FoundLens> lens_by_tracking(const TrackSettings& settings, const FrameSource& source,
                                          const TrackCallbacks& callbacks) {
  TrackSettings quiet = settings;
  for (std::string* file : {&quiet.checkpoint, &quiet.map, &quiet.save_map}) file->clear();
  quiet.final = "none";
  std::vector<FoundLens> lenses;
  for (const double guess : kGuesses) {
    lenses.push_back({pinhole_camera(guess * std::max(source.width(), source.height()), source), {}, {}});
  }
  for (int round = 0; round < kMostGuesses; ++round) {
    for (FoundLens& lens : lenses) {
      lens.prior = kGuessed;
      lens.is_guess = true;
      const std::optional<FoundLens> refined = refined_guess(quiet, callbacks, lens);
      if (!refined) return std::nullopt;
      lens = *refined;
    }
    if (std::optional<FoundLens> agreed = agreement(lenses)) return agreed;
  }
  return std::nullopt;
}

}  // namespace raysfm
