// What the settings of `track` are called, and what they say to the pipeline.
#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <string_view>
#include <utility>

#include "raysfm/api/track.h"
#include "raysfm/files/text_file.h"

namespace raysfm {
namespace {

// Everything as in LBA09, as far as it can be chosen: what the paper does not have is left out.
void follow_paper(TrackSettings* settings) {
  settings->refine_lens = settings->loops = "off";
  settings->rolling_shutter = "none";
  settings->odometry.paper_window = true;
  settings->odometry.departures = kNoDepartures;
}

// The methods that the settings name, for the pipeline.
Result<void> choose_methods(TrackSettings* settings) {
  static constexpr std::pair<std::string_view, ErrorMeasure> kErrors[] = {
      {"auto", ErrorMeasure::kAuto},
      {"pixel", ErrorMeasure::kPixel},
      {"angular", ErrorMeasure::kAngular},
      {"angular-plain", ErrorMeasure::kAngularPlain}};
  static constexpr std::pair<std::string_view, GenericStartMethod> kStarts[] = {
      {"auto", GenericStartMethod::kAuto},
      {"five-point", GenericStartMethod::kCentral},
      {"pless", GenericStartMethod::kSeventeenPoint}};
  static constexpr std::pair<std::string_view, LensRefinement> kRefinements[] = {
      {"auto", LensRefinement::kAuto}, {"on", LensRefinement::kOn}, {"off", LensRefinement::kOff}};
  static constexpr std::pair<std::string_view, bool> kLoops[] = {{"on", true}, {"off", false}};
  static constexpr std::pair<std::string_view, FinalAdjustment> kFinals[] = {
      {"none", FinalAdjustment::kGlobal},
      {"global", FinalAdjustment::kGlobal},
      {"hierarchical", FinalAdjustment::kHierarchical}};
  const auto choose = [](const auto& table, const char* flag, const std::string& name,
                         auto* value) -> Result<void> {
    for (const auto& [known, method] : table) {
      if (known == name) return *value = method, Result<void>();
    }
    return bad_input(fmt::format("{} = {}: unknown; see --help", flag, name));
  };
  const bool as_paper = settings->preset == "lba09";
  if (as_paper) follow_paper(settings);
  if (auto r = leave_out(settings->without, &settings->odometry.departures); !r) return r;
  if (auto r = choose(kErrors, "--error", settings->error, &settings->odometry.error); !r) return r;
  if (as_paper && settings->error == "auto") settings->odometry.error = ErrorMeasure::kPaper;
  if (auto r = choose(kStarts, "--start", settings->start, &settings->odometry.start); !r) return r;
  if (auto r = choose(kLoops, "--loops", settings->loops, &settings->odometry.loops); !r) return r;
  if (auto r = choose(kFinals, "--final", settings->final, &settings->odometry.final); !r) return r;
  return choose(kRefinements, "--refine-lens", settings->refine_lens, &settings->odometry.refine_lens);
}

}  // namespace

std::vector<SettingField> setting_fields(TrackSettings& s) {
  OdometryOptions& o = s.odometry;
  return {
      {"camera",
       "camera file; default: the one beside the images, else the lens is found from the footage",
       &s.camera,
       {}},
      {"fov",
       "horizontal field of view in degrees, 5 to 150, for footage that does not tell the lens",
       &s.fov,
       {}},
      {"fps", "frames per second of images without timestamps", &s.fps, {}},
      {"from", "seconds of the input at which to begin", &s.range.from, {}},
      {"to", "seconds of the input at which to end; 0 for all of it", &s.range.to, {}},
      {"mono", "use only the first camera of a stereo layout", &s.mono, {}},
      {"seed", "seed of every random choice", &o.seed, {}},
      {"threads", "worker threads; 0 for as many as the machine has", &s.threads, {}},
      {"error", "residual that is minimised", &s.error, {"auto", "pixel", "angular", "angular-plain"}},
      {"start", "how the first views are posed", &s.start, {"auto", "five-point", "pless"}},
      {"refine-lens", "whether a calibration that is off is refined", &s.refine_lens, {"auto", "on", "off"}},
      {"rolling-shutter",
       "auto, none, or milliseconds from the first row of an image to the last; auto: as the camera file "
       "says",
       &s.rolling_shutter,
       {}},
      {"loops", "whether places seen before close loops and join worlds", &s.loops, {"on", "off"}},
      {"map", "saved map to go on from", &s.map, {}},
      {"save-map", "saved map to leave, for later runs", &s.save_map, {}},
      {"localise", "only poses in --map, which stays as it is", &s.localise, {}},
      {"final", "adjustment of everything at the end", &s.final, {"none", "global", "hierarchical"}},
      {"features", "corners per frame", &o.features, {}},
      {"min-matches", "fewer matches with the last key frame ask for a new one", &o.min_matches, {}},
      {"free-cameras", "key frames that a local adjustment moves", &o.free_cameras, {}},
      {"window", "key frames that a local adjustment observes", &o.window, {}},
      {"global-until", "key frames up to which everything is adjusted", &o.global_until, {}},
      {"preset",
       "lba09: as the paper, for comparison; refines no calibration, closes no loops, and leaves out all "
       "that "
       "--without and --paper-window name",
       &s.preset,
       {"none", "lba09"}},
      {"without",
       "what to leave out of what the paper does not have, separated by commas: blur, earlier, keyframes, "
       "noise, parallax, surfaces, turning",
       &s.without,
       {}},
      {"paper-window",
       "local adjustments as LBA09 2.5 has them, for experiments: nothing older than the window is observed, "
       "which "
       "may be as small as --free-cameras",
       &o.paper_window,
       {}},
  };
}

std::string effective_config(TrackSettings settings, const std::string& version) {
  return effective_config(setting_fields(settings), settings.inputs, version);
}

Result<OdometryOptions> odometry_options(const TrackSettings& given) {
  TrackSettings settings = given;
  if (auto r = choose_methods(&settings); !r) return r.error();
  settings.odometry.starts_worlds = !settings.localise;
  return settings.odometry;
}

Result<void> set_rolling_shutter(const std::string& told, Rig* rig, CalibrationPrior* prior) {
  constexpr double kMostMs = 1000;
  const auto scans = [](const Camera& camera) { return camera.shutter.readout > 0; };
  if (told == "auto") {
    if (std::ranges::none_of(rig->cameras, scans)) prior->readout = kUsualReadout;
    return {};
  }
  const std::optional<double> ms = told == "none" ? 0 : parse_number(told);
  if (!ms || !(*ms >= 0 && *ms <= kMostMs)) {
    return bad_input(
        fmt::format("--rolling-shutter = '{}': must be auto, none or 0 to {} milliseconds", told, kMostMs));
  }
  for (Camera& camera : rig->cameras) camera.shutter.readout = *ms / 1000;
  return {};
}

}  // namespace raysfm
