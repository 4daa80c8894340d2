// lens_by_tracking(): the lens that maps tell, where no stretch of the footage tells one.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <span>
#include <string>

#include "raysfm/api/find_lens.h"
#include "raysfm/scene/worlds.h"

namespace raysfm {
namespace {

// Focal lengths to begin with, in parts of the longer side of the image: of 76 and 50 degrees. From either,
// tracking finds lenses that are half as far again to both sides, and those of action cameras, whose
// distortion is a fifth at the rim. The others, of 63, 35 and 24 degrees, take the place of those whose maps
// tell nothing.
constexpr std::array kGuesses = {0.64, 1.07, 0.82, 1.6, 2.4};
constexpr CalibrationPrior kGuessed{.focal = 0.2, .centre = 0.02, .rim = 0.2, .is_guess = true};
// Of a lens that a stretch told, though vaguely.
constexpr CalibrationPrior kVaguelyTold{.focal = 0.2, .centre = 0.02, .rim = 0.05};
constexpr int kMostTracked = 900;
constexpr int kMostRuns = 5;  // from a guess, each from where the one before it ended
// By how much the two may end apart, or more by so many standard deviations of their difference; and from
// where their last runs began, as a part of the focal length: from far off both may stop at the same place
// half-way. And what must have a place.
constexpr double kAgree = 0.03, kSigmas = 2, kMostApart = 0.1, kStays = 0.1, kMostlyPlaced = 0.5;
// Standard deviation of a focal length from a stretch, as a part of it, beyond which it says nothing; and by
// how much the map made from there may end apart.
constexpr double kMostVague = 0.2, kNear = 0.1;
// By how much the principal point of a crop may move, as a part of the larger side.
constexpr double kCentreStays = 0.03;

// A crop's map fits no worse than those of lenses whose axis is in the middle: by how much, at most.
constexpr double kWorse = 1.1;

// A lens, and the errors of the map that told it.
struct ToldByMap {
  FoundLens lens;
  double rms_px = 0;
};

// From a guess, on and on from where its map ended.
struct Way {
  FoundLens lens;
  double step = INFINITY;  // of its last run, as apart(); infinite where its map told nothing

  bool told() const { return step < INFINITY; }
  bool stays() const { return step <= kStays; }
};

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
std::optional<ToldByMap> refined_guess(const TrackSettings& settings, const TrackCallbacks& callbacks,
                                       FoundLens guess, const CalibrationPrior& prior) {
  guess.prior = prior;
  guess.is_guess = true;
  FrameLimit limit(callbacks);
  TrackCallbacks unheard;
  unheard.stop = &limit.stop;
  const Result<TrackResult> run = track(settings, unheard, &limit, &guess);
  if (!run || callbacks.stopped()) return std::nullopt;
  const Reconstruction& r = run->reconstruction;
  const auto focal = std::ranges::find(r.calibration, "fx", &CalibrationNumber::name);
  if (focal == r.calibration.end() || !focal->told) return std::nullopt;
  if (placed_count(r) < kMostlyPlaced * static_cast<double>(r.frames.size())) return std::nullopt;
  FoundLens lens{Rig{{r.rig.cameras[0]}}, {}, {}};
  lens.rig.cameras[0].shutter = {};
  lens.origin = {.source = "footage",
                 .first_frame = 0,
                 .last_frame = static_cast<int>(r.frames.size()) - 1,
                 .focal = focal->refined,
                 .focal_sigma = focal->sigma / focal->refined};
  return ToldByMap{std::move(lens), r.rms_reprojection_px};
}

// No lens is surer than it is far from what else was found, as a part of the focal length.
void doubt(double apart, FoundLens* lens) {
  lens->origin.focal_sigma = std::max(lens->origin.focal_sigma, apart);
  lens->prior.focal = std::max(lens->prior.focal, lens->origin.focal_sigma);
}

double apart(const FoundLens& a, const FoundLens& b) {
  return std::abs(std::log(a.origin.focal / b.origin.focal));
}

// The one whose map is surest, where both say the same; where both stay, as far as they say how sure they
// are.
std::optional<FoundLens> agreement(std::span<const Way, 2> ways) {
  const LensOrigin &a = ways[0].lens.origin, &b = ways[1].lens.origin;
  const double off = apart(ways[0].lens, ways[1].lens), sigma = std::hypot(a.focal_sigma, b.focal_sigma);
  const bool both_stay = ways[0].stays() && ways[1].stays();
  if (off > (both_stay ? std::max(kAgree, std::min(kSigmas * sigma, kMostApart)) : kAgree))
    return std::nullopt;
  FoundLens best = ways[b.focal_sigma < a.focal_sigma].lens;
  doubt(off, &best);
  return best;
}

// Where the optical axis meets the image, as parts of its larger side from the middle.
Eigen::Vector2d centre_of(const FoundLens& lens) {
  const Camera& camera = lens.rig.cameras[0];
  const Eigen::Vector2d size(camera.width, camera.height);
  Eigen::Vector2d centre;
  if (!camera.project(Eigen::Vector3d::UnitZ(), &centre)) return Eigen::Vector2d::Zero();
  return (centre - 0.5 * (size - Eigen::Vector2d::Ones())) / size.maxCoeff();
}

// Whether an optical axis that is far from the middle of the images stays there: those of a crop do. Where a
// rolling shutter that turns on the spot, or another lens, made it seem so, tracking has other reasons.
bool centre_holds(const FoundLens& vague, const FoundLens& refined) {
  return !vague.is_aside || (centre_of(refined) - centre_of(vague)).norm() <= kCentreStays;
}

// For the user to see that something goes on.
void tell_run(const TrackCallbacks& callbacks, const FoundLens& from, const std::optional<ToldByMap>& told) {
  const std::string end = told ? fmt::format("ends at {:.1f}", told->lens.origin.focal) : "tells none";
  tell(callbacks.event, Event::Level::kInfo,
       fmt::format("tracking from a focal length of {:.1f} pixels {}", from.origin.focal, end));
}

// From what a stretch says; none where its map says something else.
std::optional<ToldByMap> refined_vague(const TrackSettings& settings, const TrackCallbacks& callbacks,
                                       const FoundLens& vague) {
  if (!(vague.origin.focal_sigma <= kMostVague)) return std::nullopt;
  std::optional<ToldByMap> told = refined_guess(settings, callbacks, vague, kVaguelyTold);
  if (!told) return std::nullopt;
  const double off = apart(told->lens, vague);
  if (off > kNear || !centre_holds(vague, told->lens)) return std::nullopt;
  doubt(off, &told->lens);
  return told;
}

}  // namespace

std::optional<FoundLens> lens_by_tracking(const TrackSettings& settings, const FrameSource& source,
                                          const std::optional<FoundLens>& vague,
                                          const TrackCallbacks& callbacks) {
  TrackSettings quiet = settings;
  for (std::string* file : {&quiet.checkpoint, &quiet.map, &quiet.save_map}) file->clear();
  quiet.final = "none";
  quiet.odometry.finishes_maps = false;
  std::optional<ToldByMap> crop;
  if (vague) {
    crop = refined_vague(quiet, callbacks, *vague);
    if (crop && !vague->is_aside) return crop->lens;
  }
  const auto guessed = [&](double guess) {
    const double focal = guess * std::max(source.width(), source.height());
    return FoundLens{.rig = Rig{{pinhole_camera(focal, source)}}, .prior = {}, .origin = {.focal = focal}};
  };
  const auto* next = kGuesses.begin();
  std::array ways = {Way{guessed(*next++)}, Way{guessed(*next++)}};
  for (int run = 0; run < kMostRuns; ++run) {
    const bool one_waits = ways[0].stays() != ways[1].stays();
    for (Way& way : ways) {
      if (one_waits && way.stays()) {
        way.step = 0;
        continue;
      }
      const std::optional<ToldByMap> told = refined_guess(quiet, callbacks, way.lens, kGuessed);
      if (callbacks.stopped()) return std::nullopt;
      tell_run(callbacks, way.lens, told);
      if (!told && next == kGuesses.end()) return std::nullopt;
      way = told ? Way{told->lens, apart(told->lens, way.lens)} : Way{guessed(*next++)};
      if (told && crop && crop->rms_px > kWorse * told->rms_px) crop.reset();
    }
    if (crop) return crop->lens;
    // One that comes from afar to where the other stays is as good.
    const bool both_told = ways[0].told() && ways[1].told();
    if (!both_told || !(ways[0].stays() || ways[1].stays())) continue;
    if (std::optional<FoundLens> agreed = agreement(ways)) return agreed;
    if (ways[0].step == 0 && ways[1].step == 0) return std::nullopt;
  }
  return std::nullopt;
}

}  // namespace raysfm
