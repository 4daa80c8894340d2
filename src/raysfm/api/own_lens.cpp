// track_with_own_lens(): other lenses than those of a camera file that is doubted.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <string>
#include <vector>

#include "raysfm/api/find_lens.h"
#include "raysfm/api/given_lens.h"
#include "raysfm/api/track_sources.h"
#include "raysfm/api/track_zoom.h"
#include "raysfm/calibration/rig_parameters.h"
#include "raysfm/scene/frame_lens.h"
#include "raysfm/scene/worlds.h"

namespace raysfm {
namespace {

// Runs with the cameras of a file at other focal lengths, until these stay: how many at most, and by how much
// they may still differ, as a logarithm.
constexpr int kMostRounds = 4;
constexpr double kSettled = 0.01;
// Where nothing tells the focal length of a camera that is doubted: what it is multiplied by, in turn. Maps
// tell it mostly from a quarter off.
constexpr std::array kFactors = {1.4, 0.7, 2.0, 0.5};
// What residuals that spoke against a lens come down to with a better one.
constexpr double kMuchBetter = 0.8;

// To the focal lengths of the given cameras, one for each; 0: not known.
using Factors = std::vector<double>;

bool is_perspective(const Camera& camera) {
  return lens_of(camera).has_value();
}

// Whether cameras have the same lens, as far as a file says.
bool are_of_one_make(const Camera& a, const Camera& b) {
  return a.model.index() == b.model.index() && a.width == b.width && a.height == b.height &&
         !are_other_lenses(a.pixels_per_radian(), b.pixels_per_radian());
}

Camera scaled(const Camera& camera, double factor) {
  if (factor == 1) return camera;
  const RigParameters parameters(Rig{{camera}});
  Eigen::VectorXd values = Eigen::VectorXd::Zero(parameters.size());
  for (int i = 0; i < parameters.size(); ++i) {
    if (parameters[i].kind == RigParameters::Kind::kFocal) values[i] = std::log(factor);
  }
  return parameters.rig(values).cameras[0];
}

bool is_told_focal(const CalibrationNumber& number) {
  return number.name == "fx" && number.told;
}

// Looks for the lenses with which the same footage is tracked better than with those of a camera file.
class OwnLensSearch {
 public:
  OwnLensSearch(const TrackSettings& settings, const std::atomic<bool>* stop, const GivenCameras& given,
                const std::vector<LensDoubt>& doubts, const TrackResult& tracked)
      : settings_(settings), cameras_(given.rig.cameras), doubts_(doubts), tracked_(tracked) {
    settings_.checkpoint.clear();  // of the run with the file's
    quiet_.stop = stop;
    is_alone_ = cameras_.size() == 1;
  }

  std::optional<TrackResult> find() {
    const LensDoubt& first = doubts_[0];
    // Its footage is tracked from guesses for that, and may show that the camera zooms.
    if (is_alone_ && is_perspective(cameras_[0])) return tracked_with_lens_of(first);
    Factors told = told_by_first_run();
    Factors known = told;
    for (const LensDoubt& doubt : doubts_) known[doubt.camera] = 0;
    if (auto better = settled(told, known)) return better;
    if (!is_alone_) {
      told = told_by_each(told);
      if (auto better = settled(told, told)) return better;
    }
    if (auto better = guessed(told)) return better;
    if (!is_alone_) return std::nullopt;
    return tracked_with_lens_of(first);
  }

  // Whether the camera file is most likely wrong, where nothing better was found: corners alone may err, and
  // so do residuals of one perspective camera, whose footage tells more than those of any other.
  bool is_sure() const {
    return is_confirmed_ || std::ranges::any_of(doubts_, [&](const LensDoubt& d) {
             if (d.by == LensDoubt::By::kMisfit) return !is_alone_ || !is_perspective(cameras_[0]);
             return d.by != LensDoubt::By::kCorners;
           });
  }

 private:
  bool map_tells() const {
    return std::ranges::any_of(doubts_, [](const LensDoubt& d) { return d.by == LensDoubt::By::kMap; });
  }

  // Whether the result takes the place of that with the camera file: it explains what that did not.
  bool is_good(const TrackResult& own) const {
    const Reconstruction& r = own.reconstruction;
    if (!reaches_enough(own, tracked_.reconstruction)) return false;
    const std::vector<CameraFit> fits = fits_of_cameras(r, TrackingRig(r.rig));
    for (const CalibrationNumber& n : r.calibration) {
      if (n.name == "fx" && !n.told && fits[n.camera].is_bad) return false;
      if (fits[n.camera].is_apart) return false;
    }
    return std::ranges::all_of(
        doubts_, [&](const LensDoubt& d) { return d.rms == 0 || fits[d.camera].rms <= kMuchBetter * d.rms; });
  }

  std::optional<FoundLens> own_lens_of(const LensDoubt& doubt) const {
    Result<Input> input = open_inputs(settings_, true);
    if (!input || (!is_alone_ && input->streams.size() != cameras_.size())) return std::nullopt;
    const size_t stream = is_alone_ ? 0 : cameras_[doubt.camera].stream;
    if (stream >= input->streams.size()) return std::nullopt;
    std::swap(input->streams[0], input->streams[stream]);
    return own_lens(settings_, *std::move(input), is_alone_, quiet_);
  }

  // With what the footage of one camera tells by itself, where that is another lens.
  std::optional<TrackResult> tracked_with_lens_of(const LensDoubt& doubt) {
    const std::optional<FoundLens> own = own_lens_of(doubt);
    return own && are_other_lenses(own->origin.focal, doubt.given) ? tracked_with(*own) : std::nullopt;
  }

  std::optional<TrackResult> tracked_with(const FoundLens& own) {
    if (quiet_.stopped()) return std::nullopt;
    is_confirmed_ = true;
    Result<TrackResult> result = track(settings_, quiet_, nullptr, &own);
    const bool is_misfit = doubts_[0].by == LensDoubt::By::kMisfit;
    const bool counts =
        result && reaches_enough(*result, tracked_.reconstruction) && (!is_misfit || is_good(*result));
    return counts ? std::optional(*std::move(result)) : std::nullopt;
  }

  // What the map with the file's cameras and corners tell.
  Factors told_by_first_run() const {
    Factors told(cameras_.size(), 0);
    for (const CalibrationNumber& n : tracked_.reconstruction.calibration) {
      if (is_told_focal(n)) told[n.camera] = 1;
    }
    for (const LensDoubt& doubt : doubts_) {
      const bool is_seen = doubt.by == LensDoubt::By::kMap || doubt.by == LensDoubt::By::kCorners;
      told[doubt.camera] = is_seen ? doubt.seen / doubt.given : 0;
    }
    return told;
  }

  // Besides, what the footage of each camera tells by itself.
  Factors told_by_each(Factors factors) const {
    for (const LensDoubt& doubt : doubts_) {
      if (!is_perspective(cameras_[doubt.camera]) || quiet_.stopped()) continue;
      const std::optional<FoundLens> own = own_lens_of(doubt);
      if (own) factors[doubt.camera] = own->origin.focal / doubt.given;
    }
    return factors;
  }

  // A camera of which nothing is known has the lens of one of its make, else its own.
  Factors shared(const Factors& known) const {
    Factors factors = known;
    for (size_t c = 0; c < cameras_.size(); ++c) {
      for (size_t other = 0; other < cameras_.size() && factors[c] == 0; ++other) {
        if (are_of_one_make(cameras_[c], cameras_[other])) factors[c] = known[other];
      }
      if (factors[c] == 0) factors[c] = 1;
    }
    return factors;
  }

  // Where nothing tells the focal lengths of cameras that are doubted.
  std::optional<TrackResult> guessed(const Factors& told) {
    for (const double guess : kFactors) {
      Factors factors = told;
      for (const LensDoubt& doubt : doubts_) {
        if (doubt.by == LensDoubt::By::kMisfit && factors[doubt.camera] == 0) factors[doubt.camera] = guess;
      }
      if (factors == told) return std::nullopt;
      if (auto better = settled(factors, told)) return better;
    }
    return std::nullopt;
  }

  // What a map that was made with such focal lengths tells of them; of others, what is `known` without it.
  Factors told_by_map(const Factors& made_with, const std::vector<CalibrationNumber>& calibration,
                      const Factors& known) const {
    Factors told = known;
    for (const CalibrationNumber& n : calibration) {
      if (is_told_focal(n)) told[n.camera] = made_with[n.camera] * n.refined / n.given;
    }
    return shared(told);
  }

  // The given cameras at those focal lengths, of which some are `known` without a map, then at those that the
  // map of the footage has, until these stay. Other numbers are the file's each time: those of a map with
  // another lens were made up by it.
  std::optional<TrackResult> settled(const Factors& start, const Factors& known) {
    if (std::ranges::none_of(start, [](double f) { return f > 0 && are_other_lenses(f, 1); }))
      return std::nullopt;
    Factors factors = shared(start);
    for (int round = 0; round < kMostRounds && !quiet_.stopped(); ++round) {
      FoundLens own{{}, {}, {.source = "footage"}, true, true};
      for (size_t c = 0; c < cameras_.size(); ++c) own.rig.cameras.push_back(scaled(cameras_[c], factors[c]));
      Result<TrackResult> result = track(settings_, quiet_, nullptr, &own);
      if (!result) return std::nullopt;
      const std::vector<CalibrationNumber>& numbers = result->reconstruction.calibration;
      // What one map told another need not tell again, once all fits; of guesses none is right by itself.
      if (!map_tells() && std::ranges::none_of(numbers, is_told_focal)) return std::nullopt;
      const Factors next = told_by_map(factors, numbers, known);
      const bool stay = std::ranges::equal(
          next, factors, [](double x, double y) { return std::abs(std::log(x / y)) <= kSettled; });
      factors = next;
      if (!stay) continue;
      if (std::ranges::none_of(factors, [](double f) { return are_other_lenses(f, 1); })) return std::nullopt;
      is_confirmed_ = true;
      if (!is_good(*result)) return std::nullopt;
      tell_origin(&*result);
      return *std::move(result);
    }
    return std::nullopt;
  }

  static void tell_origin(TrackResult* result) {
    const Reconstruction& r = result->reconstruction;
    LensOrigin& origin = *result->report.lens_origin;
    origin.first_frame = 0;
    origin.last_frame = static_cast<int>(r.frames.size()) - 1;
    const auto focal = std::ranges::find(r.calibration, "fx", &CalibrationNumber::name);
    origin.focal = focal->refined;
    origin.focal_sigma = focal->sigma / focal->refined;
  }

  TrackSettings settings_;
  TrackCallbacks quiet_;
  const std::vector<Camera>& cameras_;
  const std::vector<LensDoubt>& doubts_;
  const TrackResult& tracked_;
  bool is_alone_ = false, is_confirmed_ = false;
};

std::string name_of(int camera, size_t cameras) {
  return cameras == 1 ? "the lens" : fmt::format("the lens of camera {}", camera);
}

// Of a camera; 0: it has none.
double focal_number(const Reconstruction& r, int camera, double CalibrationNumber::*value) {
  for (const CalibrationNumber& n : r.calibration) {
    if (n.name == "fx" && n.camera == camera) return n.*value;
  }
  return 0;
}

// What there is to say where the footage was tracked with its own lenses.
std::string own_lens_warning(const Reconstruction& own, const Reconstruction& with_file) {
  const int cameras = static_cast<int>(with_file.rig.cameras.size());
  std::string text;
  for (int c = 0; c < cameras; ++c) {
    const double now = focal_number(own, c, &CalibrationNumber::refined);
    const double then = focal_number(with_file, c, &CalibrationNumber::given);
    if (!(now > 0 && then > 0 && are_other_lenses(now, then))) continue;
    text += fmt::format(
        "{}{} is another one than that of the camera file: the footage tells a focal length of {:.0f} px, "
        "not {:.0f} px",
        text.empty() ? "" : "; ", name_of(c, cameras), now, then);
  }
  return text + ", and is tracked with its own";
}

}  // namespace

std::string doubt_warning(const std::vector<LensDoubt>& doubts, size_t cameras) {
  std::string text;
  for (const LensDoubt& doubt : doubts) {
    if (!text.empty()) text += "; ";
    const std::string name = name_of(doubt.camera, cameras);
    switch (doubt.by) {
      case LensDoubt::By::kMap:
        text += fmt::format(
            "{} is another one than that of the camera file: the map tells a focal length of {:.0f} px, not "
            "{:.0f} px; what was matched before that was known may be missing or wrong",
            name, doubt.seen, doubt.given);
        break;
      case LensDoubt::By::kCorners:
        text += fmt::format(
            "{} is another one than that of the camera file: the footage tells a focal length of {:.0f} px, "
            "not {:.0f} px; poses are those of the camera file, and most likely wrong",
            name, doubt.seen, doubt.given);
        break;
      case LensDoubt::By::kApart:
        text += fmt::format(
            "{} or its place in the rig is another one than that of the camera file: what it sees, other "
            "cameras that should see it too do not; poses, and above all their scale, may be wrong",
            name);
        break;
      case LensDoubt::By::kMisfit:
        text += fmt::format(
            "{} may be another one than that of the camera file: {}, and nothing tells its focal length; "
            "poses may be wrong",
            name,
            doubt.rms > 0 ? fmt::format("what it sees is {:.1f} px from where the map has it", doubt.rms)
                          : "little of what it sees fits the map");
        break;
    }
  }
  return text;
}

std::optional<TrackResult> track_with_own_lens(const TrackSettings& settings, const TrackCallbacks& callbacks,
                                               const GivenCameras& given,
                                               const std::vector<LensDoubt>& doubts,
                                               const TrackResult& tracked, std::string* warning) {
  OwnLensSearch search(settings, callbacks.stop, given, doubts, tracked);
  // A saved map is that of its cameras.
  if (given.can_be_read_again && settings.map.empty() && settings.save_map.empty()) {
    tell(callbacks.event, Event::Level::kInfo,
         "track is not sure of the lens of the camera file: the footage is asked for its own");
    if (std::optional<TrackResult> own = search.find()) {
      *warning = own_lens_warning(own->reconstruction, tracked.reconstruction);
      return own;
    }
  }
  if (search.is_sure()) *warning = doubt_warning(doubts, given.rig.cameras.size());
  return std::nullopt;
}

}  // namespace raysfm
