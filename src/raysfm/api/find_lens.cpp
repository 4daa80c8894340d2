#include "raysfm/api/find_lens.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <vector>

#include "raysfm/camera/camera_check.h"
#include "raysfm/camera/stretch.h"
#include "raysfm/core/thread_pool.h"
#include "raysfm/projective/video_motion.h"
#include "raysfm/ray_lenses/turn_lens.h"
#include "raysfm/ray_lenses/wide_lens.h"
#include "raysfm/scene/frame_lens.h"
#include "raysfm/solving/solve_tracks.h"
#include "raysfm/uncalibrated/video_reconstruct.h"

namespace raysfm {
namespace {

// A stretch has so many frames that repeat no other, more where there is so little motion that key frames are
// few.
constexpr int kFrames = 200, kMostFrames = 600, kFewKeyframes = 12;
constexpr double kShare = 0.5;      // of the points of a key frame, which the one two before sees as well
constexpr int kStretches = 6;       // with a reconstruction
constexpr int kAllStretches = 30;   // also those that have none, which is mostly seen at once
constexpr int kFirstStretches = 6;  // that are asked for another lens where they have no reconstruction
// Standard deviations of focal lengths, as a part of them: those of a stretch are too small by about so
// much on real footage, whose errors are no noise. Below the first no further stretch is looked at; above
// the second the lens is not told.
constexpr double kOptimism = 3, kSure = 0.06, kUsable = 0.1;
// Parts of the matches of images far apart that turns explain: a lens is taken from turns from the first on,
// above the second all there is to see is one.
constexpr double kManyTurn = 0.4, kAllTurn = 0.9;
constexpr double kLeastPosed = 0.3;  // part of the frames of a stretch
// Standard deviations of the principal point from the middle of the image beyond which something else bends a
// stretch, such as a rolling shutter that turns on the spot.
constexpr double kMostAside = 4;
// What a field of view that is told may be off by: makers give it of the sensor, or with another crop.
constexpr CalibrationPrior kTold{.focal = 0.1, .centre = 0.02, .rim = 0.2, .is_guess = true};
// Between these lie the standard deviations of the other numbers of a lens that is found.
constexpr CalibrationPrior kSurest{.centre = 0.002, .rim = 0.005}, kVaguest{.centre = 0.03, .rim = 0.03};
constexpr double kLeastFov = 5, kMostFov = 150;  // degrees
// Degrees of which k1 and k2 describe any lens: a fisheye of 140 degrees is found with 112 and one of 190
// with 131, on paths that are 1 to 3 % wrong; one of 100 degrees is found with 98, and its path is right.
constexpr double kWide = 105;

double radians(double degrees) {
  return degrees * std::numbers::pi / 180;
}

double focal_of_fov(double fov_deg, int width) {
  return 0.5 * width / std::tan(0.5 * radians(fov_deg));
}

// What a stretch of the footage says: a lens, or why it says none.
struct Telling {
  std::optional<FoundLens> lens;
  std::string reason;  // or what speaks for a lens that is not perspective
  bool reconstructed = true;
  bool zooms = false;                    // by the look of it; the lens is the best single one
  std::optional<FoundLens> vague = {};   // that it says too little of to be told
  std::optional<FoundLens> turned = {};  // by a turn, without any structure
};

bool is_long_enough(const TrackJoiner& joiner) {
  return joiner.pictures() >= kMostFrames ||
         (joiner.pictures() >= kFrames && joiner.keyframes() >= kFewKeyframes);
}

// How far off a lens may be that so large a part of a stretch's key frames agrees with.
CalibrationPrior prior_of(const UncalibratedReconstruction& found, int image, const PointTracks& tracks,
                          double posed) {
  const double doubt = kOptimism / posed;
  const LensVector& sigma = found.lens_sigma[image];
  const double focal = found.scene.lenses[image].fx;
  const double rim2 = std::min(1.0, (0.5 * tracks.image_size / focal).squaredNorm());
  CalibrationPrior prior{.focal = doubt * sigma[0] / focal, .without_shutter = true};
  prior.centre = std::clamp(doubt * std::max(sigma[2], sigma[3]) / tracks.image_size.maxCoeff(),
                            kSurest.centre, kVaguest.centre);
  prior.rim = kVaguest.rim;
  if (!found.radial.none()) {
    const double rim = std::max(found.radial_sigma.k1 * rim2, found.radial_sigma.k2 * rim2 * rim2);
    prior.rim = std::clamp(doubt * rim, kSurest.rim, kVaguest.rim);
  }
  return prior;
}

// The key frames, without those between two that share enough points as they are.
std::vector<int> chosen_keyframes(const SolveInput& stretch) {
  const PointTracks& tracks = stretch.tracks;
  std::vector<std::vector<int>> seen(tracks.image_count);
  for (int k = 0; k < tracks.size(); ++k) seen[tracks.image[k]].push_back(tracks.point[k]);
  std::vector<int> keyframes;
  for (int j = 0; j < tracks.image_count; ++j) {
    if (stretch.keyframe[j]) keyframes.push_back(j);
  }
  if (keyframes.size() < 3) return keyframes;
  std::vector<int> chosen = {keyframes.front()};
  std::vector<uint8_t> marked(tracks.point_count);
  for (size_t i = 1; i < keyframes.size(); ++i) {
    const bool is_last = i + 1 == keyframes.size();
    std::ranges::fill(marked, 0);
    for (const int point : seen[chosen.back()]) marked[point] = 1;
    const std::vector<int>& next = seen[keyframes[is_last ? i : i + 1]];
    const auto shared = std::ranges::count_if(next, [&](int point) { return marked[point]; });
    if (is_last || shared < kShare * static_cast<double>(next.size())) chosen.push_back(keyframes[i]);
  }
  return chosen;
}

// What the chosen key frames alone see.
PointTracks seen_by_keyframes(const SolveInput& stretch) {
  const std::vector<int> keyframes = chosen_keyframes(stretch);
  std::vector<int> number(stretch.keyframe.size(), -1), place(stretch.tracks.point_count, -1);
  PointTracks few;
  few.image_size = stretch.tracks.image_size;
  few.image_count = static_cast<int>(keyframes.size());
  for (size_t j = 0; j < keyframes.size(); ++j) number[keyframes[j]] = static_cast<int>(j);
  for (int k = 0; k < stretch.tracks.size(); ++k) {
    const int image = number[stretch.tracks.image[k]];
    if (image < 0) continue;
    int& point = place[stretch.tracks.point[k]];
    if (point < 0) point = few.point_count++;
    few.add(image, point, stretch.tracks.pixel[k]);
  }
  return few;
}

// A camera that was found in images of a stretch, with standard deviations of its numbers to which what no
// spread tells of is added; how sure it is at the rim is left to the caller.
FoundLens lens_of_camera(const Camera& camera, double focal_sigma, double centre_sigma, int first_frame,
                         int images, double doubt) {
  constexpr double kModelError = 0.005;
  FoundLens lens{Rig{{camera}}, {}, {}};
  lens.rig.cameras[0].name = "camera";
  lens.prior.without_shutter = true;
  lens.prior.focal = doubt * std::hypot(focal_sigma, kModelError);
  lens.prior.centre = std::clamp(doubt * centre_sigma, kSurest.centre, kVaguest.centre);
  lens.origin = {.source = "footage",
                 .first_frame = first_frame,
                 .last_frame = first_frame + images - 1,
                 .focal = camera.pixels_per_radian(),
                 .focal_sigma = lens.prior.focal};
  return lens;
}

// A lens that was found along rays, as one that solve() finds.
FoundLens lens_along_rays(const RayReconstruction& found, const PointTracks& tracks, int first_frame,
                          double posed) {
  const double doubt = kOptimism / posed;
  FoundLens lens = lens_of_camera(found.camera, found.sigma.focal, found.sigma.centre, first_frame,
                                  tracks.image_count, doubt);
  lens.prior.rim = std::clamp(doubt * found.sigma.rim, kSurest.rim, kVaguest.rim);
  lens.told_apart = true;
  return lens;
}

// Whether a reconstruction knows its focal length well enough for a lens to be taken from it.
bool is_told(const UncalibratedReconstruction& found, const PointTracks& tracks) {
  const double posed = found.posed_share();
  return found.degenerate.empty() && posed >= kLeastPosed && !found.lens_sigma.empty() &&
         lens_of_stretch(found, tracks, 0, posed).prior.focal <= kUsable;
}

// Whether another lens may make of these tracks what no perspective lens does. A fisheye bends the lines on
// which points move; a turning camera, a plane and no motion look like these to any lens.
bool may_tell_other_lens(const PointTracks& tracks, const SolveOptions& options) {
  std::vector<int> images(tracks.image_count);
  std::iota(images.begin(), images.end(), 0);
  const std::string name =
      hopeless_motion(motion_shares(tracks, images, options.max_error_px, options.seed)).name;
  return name.empty() || name == "pure translation";
}

// How far the principal point is from the middle, as a part of the image's larger side.
double centre_aside(const UncalibratedReconstruction& found, const PointTracks& tracks) {
  const int image = found.first_posed();
  const Lens& lens = found.scene.lenses[image];
  const Eigen::Vector2d middle = 0.5 * (tracks.image_size - Eigen::Vector2d::Ones());
  return (Eigen::Vector2d(lens.cx, lens.cy) - middle).norm() / tracks.image_size.maxCoeff();
}

// Something bends a stretch: a rolling shutter, or a lens that is no perspective one.
bool is_aside(const UncalibratedReconstruction& found, const PointTracks& tracks,
              const SolveOptions& options) {
  return centre_aside(found, tracks) > kMostAside * options.principal_point_sigma;
}

// Asked for where a perspective lens does not do, as far as its reconstruction tells. `is_early`: of one of
// the first stretches.
WideLensSearch wide_lens_of(const PointTracks& tracks, const Result<UncalibratedReconstruction>& found,
                            const SolveOptions& options, const TrackSettings& settings, bool is_early) {
  RayOptions along_rays{.max_error_px = options.max_error_px,
                        .centre_sigma = options.principal_point_sigma,
                        .seed = options.seed,
                        .threads = thread_count(settings.threads)};
  along_rays.stopped = [&options] { return options.stopped(); };
  if (!found) {
    return is_early && may_tell_other_lens(tracks, options) ? find_wide_lens(tracks, nullptr, along_rays)
                                                            : WideLensSearch();
  }
  const PerspectiveFit fit{found->scene, found->radial, found->image_posed, found->point_placed,
                           found->inlier};
  const bool does =
      is_told(*found, tracks) && !is_aside(*found, tracks, options) && !may_be_wide_lens(tracks, fit);
  return does ? WideLensSearch() : find_wide_lens(tracks, &fit, along_rays);
}

bool is_sure(const std::optional<FoundLens>& lens) {
  return lens && lens->prior.focal <= kSure;
}

// A lens that turns tell stands in for one that a stretch tells badly; and for any other where all that is
// seen is a turn: what a fisheye sees of one is what a perspective lens sees of some scene that it moves
// through.
void mind_turns(const SolveInput& stretch, int first_frame, uint64_t seed, Telling* telling) {
  constexpr double kRim = 0.1;
  const SolveOptions options;
  const auto found = lens_of_turn(
      stretch.tracks,
      {.max_error_px = options.max_error_px, .centre_sigma = options.principal_point_sigma, .seed = seed});
  if (!found || found->explained < kManyTurn) return;
  FoundLens lens = lens_of_camera(found->camera, found->focal_sigma, found->centre_sigma, first_frame,
                                  stretch.tracks.image_count, kOptimism);
  lens.prior.rim = kRim;
  if (!is_sure(lens)) return;
  const bool all_turn = found->explained > kAllTurn;
  if (is_sure(telling->lens) && !all_turn) return;
  if (all_turn) telling->lens.reset();
  telling->turned = std::move(lens);
  telling->zooms = false;  // which would be no turn through one lens
}

Telling lens_told_by(const SolveInput& stretch, int first_frame, const TrackSettings& settings,
                     const std::atomic<bool>* stop, bool is_early) {
  if (std::string still = no_motion(stretch); !still.empty()) return {{}, std::move(still), false};
  SolveOptions options;
  options.lens = LensChange::kFixed;
  options.seed = settings.odometry.seed;
  options.threads = thread_count(settings.threads);
  if (stop) options.go_on = [stop](const IterationInfo&) { return !stop->load(); };
  const PointTracks tracks = seen_by_keyframes(stretch);
  const std::vector<uint8_t> all(tracks.image_count, 1);
  const auto found = reconstruct_video(tracks, all, options, {.stop = stop});
  const WideLensSearch wide = wide_lens_of(tracks, found, options, settings, is_early);
  if (wide.found) {
    const double posed = static_cast<double>(wide.found->posed) / tracks.image_count;
    const FoundLens lens = lens_along_rays(*wide.found, stretch.tracks, first_frame, posed);
    if (posed >= kLeastPosed && lens.prior.focal <= kUsable) return {lens, wide.evidence};
  }
  if (!found) return {{}, found.error().message, false};
  if (!found->degenerate.empty()) return {{}, found->degenerate};
  const double posed = found->posed_share();
  if (posed < kLeastPosed || found->lens_sigma.empty()) {
    return {{}, fmt::format("{:.0f} % of the key frames agree with one", 100 * posed)};
  }
  Telling telling{lens_of_stretch(*found, stretch.tracks, first_frame, posed), {}};
  telling.lens->told_apart = wide.compared;
  if (is_aside(*found, stretch.tracks, options)) {
    telling.lens->is_aside = true;
    return {{},
            fmt::format("the optical axis would meet the image {:.0f} % of its size from its middle",
                        100 * centre_aside(*found, stretch.tracks)),
            true,
            false,
            telling.lens};
  }
  const bool is_wide = !wide_lens_warning(telling.lens->camera()).empty();
  telling.zooms = !is_wide && signs_of_zoom(tracks, std::vector<uint8_t>(tracks.image_count, 1), options,
                                            ErrorRelation::kAlongTracks, *found)
                                  .zooms;
  const double sigma = telling.lens->prior.focal;
  if (!(sigma <= kUsable)) {
    telling = {{},
               fmt::format("the focal length is known to {:.0f} % only", 100 * sigma),
               true,
               telling.zooms,
               telling.lens};
  }
  return telling;
}

bool is_surer(const std::optional<FoundLens>& a, const std::optional<FoundLens>& b) {
  return a && (!b || a->prior.focal < b->prior.focal);
}

std::string described(const Telling& telling, int end) {
  const std::optional<FoundLens>& lens = telling.turned ? telling.turned : telling.lens;
  if (!lens) return fmt::format("no lens from the frames before {}: {}", end, telling.reason);
  const LensOrigin& o = lens->origin;
  const std::string besides = telling.turned ? "by how images turn" : telling.reason;
  return fmt::format("frames {} to {} tell a focal length of {:.1f} pixels, right within {:.1f} %{}{}",
                     o.first_frame, o.last_frame, o.focal, 100 * o.focal_sigma, besides.empty() ? "" : "; ",
                     besides);
}

// Key frames of the whole input, as far as a stretch tells. `frames`: of all, -1: unknown.
double keyframes_of_all(const SolveInput& stretch, int frames) {
  const auto keyframes = static_cast<double>(std::ranges::count(stretch.keyframe, 1));
  const auto count = static_cast<double>(stretch.names.size());
  return frames < 0 ? INFINITY : keyframes * std::max(1.0, frames / count);
}

// Lenses that such tracks told, of the images as they are.
void make_as_stored(const Eigen::Vector2d& factors, const FrameSource& source, Telling* telling) {
  if (factors == Eigen::Vector2d::Ones()) return;
  for (std::optional<FoundLens>* lens : {&telling->lens, &telling->vague, &telling->turned}) {
    if (!*lens) continue;
    Camera& camera = (*lens)->rig.cameras[0];
    if (!stretch(factors.cwiseInverse(), &camera)) continue;
    camera.width = source.width();
    camera.height = source.height();
    (*lens)->origin.focal /= factors.x();
  }
}

// The best of what stretch after stretch tells; none where the footage tells no lens, or to stop.
Result<Telling> ask_footage(const TrackSettings& settings, TrackReader& reader,
                            const TrackCallbacks& callbacks, ZoomedStretch* zoom) {
  Telling best{{}, "interrupted"};
  int begin = 0, reconstructed = 0;
  for (int i = 0; i < kAllStretches && reconstructed < kStretches; ++i) {
    Result<SolveInput> stretch = reader.read(
        [&](const TrackJoiner& joiner) { return !callbacks.stopped() && !is_long_enough(joiner); });
    if (!stretch) return stretch.error();
    if (begin == 0 && stretch->names.empty() && !callbacks.stopped()) {
      return bad_input(fmt::format("{}: no frames", reader.source().description()));
    }
    if (stretch->names.empty() || callbacks.stopped()) break;
    const Eigen::Vector2d factors = Eigen::Vector2d(reader.source().pixel_aspect(), 1) / stretch->corner_side;
    stretch_images(factors, &stretch->tracks);
    Telling telling = lens_told_by(*stretch, begin, settings, callbacks.stop, i < kFirstStretches);
    mind_turns(*stretch, begin, settings.odometry.seed, &telling);
    make_as_stored(factors, reader.source(), &telling);
    if (callbacks.stopped()) break;
    // A stretch that tells no lens may look so for want of what tells it.
    if (telling.zooms || telling.lens || telling.turned) *zoom = {};
    const int end = begin + static_cast<int>(stretch->names.size());
    if (telling.zooms) zoom->first_frame = begin, zoom->last_frame = end - 1;
    if (telling.zooms || (telling.reconstructed && zoom->keyframes == 0))
      zoom->keyframes = keyframes_of_all(*stretch, reader.source().frame_count());
    begin = end;
    reconstructed += telling.reconstructed;
    tell(callbacks.event, Event::Level::kInfo, described(telling, begin));
    std::optional<FoundLens> vague = is_surer(telling.vague, best.vague) ? telling.vague : best.vague;
    std::optional<FoundLens> turned = is_surer(telling.turned, best.turned) ? telling.turned : best.turned;
    if (i == 0 || is_surer(telling.lens, best.lens)) best = telling;
    best.vague = std::move(vague);
    best.turned = std::move(turned);
    if ((telling.zooms && telling.lens) || is_sure(best.lens)) break;
  }
  return best;
}

FoundLens lens_of_fov(double fov_deg, const FrameSource& source) {
  const double focal = focal_of_fov(fov_deg, source.width());
  FoundLens lens{Rig{{pinhole_camera(focal, source)}}, kTold, {}};
  lens.origin = {.source = "told field of view", .focal = focal, .focal_sigma = kTold.focal};
  return lens;
}

// What the user should know where the field of view told is not that of the footage; else empty.
std::string disagreement(const FoundLens& found, const FoundLens& told) {
  constexpr double kSigmas = 2;
  const double off = std::log(found.origin.focal / told.origin.focal);
  if (std::abs(off) <= kSigmas * std::hypot(found.prior.focal, told.prior.focal)) return "";
  return fmt::format(
      "the field of view that was told means a focal length of {:.1f} pixels, the footage says {:.1f}, "
      "which is taken",
      told.origin.focal, found.origin.focal);
}

// Whether one camera's footage is all there is.
Result<void> check_single(const TrackSettings& settings, const Input& input) {
  const size_t streams = settings.mono ? 1 : input.streams.size();
  if (streams == 1) return {};
  return bad_input(
      fmt::format("{}: no camera file for its {} cameras; give one with --camera, only the lens "
                  "of a single camera is found from the footage",
                  settings.inputs[0], streams));
}

// `vague`: what stretches say of the lens, if anything.
std::optional<FoundLens> ask_tracking(const TrackSettings& settings, const FrameSource& source,
                                      const std::optional<FoundLens>& vague,
                                      const TrackCallbacks& callbacks) {
  tell(callbacks.event, Event::Level::kInfo, "no stretch tells a lens: tracking looks for it");
  std::optional<FoundLens> lens = lens_by_tracking(settings, source, vague, callbacks);
  tell(callbacks.event, Event::Level::kInfo,
       lens ? fmt::format("tracking ends at a focal length of {:.1f} pixels, right within {:.1f} %",
                          lens->origin.focal, 100 * lens->origin.focal_sigma)
            : "no lens from tracking");
  return lens;
}

}  // namespace

Camera pinhole_camera(double focal, const FrameSource& source) {
  Camera camera;
  camera.name = "camera";
  camera.width = source.width();
  camera.height = source.height();
  camera.model =
      Pinhole{focal, focal * source.pixel_aspect(), 0.5 * (source.width() - 1), 0.5 * (source.height() - 1)};
  return camera;
}

FoundLens lens_of_stretch(const UncalibratedReconstruction& found, const PointTracks& tracks, int first_frame,
                          double posed) {
  const int image = found.first_posed();
  const CalibrationPrior prior = prior_of(found, image, tracks, posed);
  FoundLens lens{Rig{{frame_lens(found.scene.lenses[image], found.radial).camera}}, prior, {}};
  Camera& camera = lens.rig.cameras[0];
  camera.name = "camera";
  camera.width = static_cast<int>(tracks.image_size.x());
  camera.height = static_cast<int>(tracks.image_size.y());
  lens.origin = {.source = "footage",
                 .first_frame = first_frame,
                 .last_frame = first_frame + tracks.image_count - 1,
                 .focal = found.scene.lenses[image].fx,
                 .focal_sigma = lens.prior.focal};
  return lens;
}

std::string vague_lens_warning(const LensOrigin& origin) {
  if (origin.source != "footage" || !(origin.focal_sigma > kSure)) return "";
  return fmt::format(
      "the footage tells the focal length to {:.0f} % only, and the map no better: the path may be bent by "
      "that; give --camera or --fov",
      100 * origin.focal_sigma);
}

std::string wide_lens_warning(const Camera& camera) {
  if (!lens_of(camera)) return "";
  const CameraFacts facts = camera_facts(camera);
  const double wide = std::max(facts.fov_horizontal_deg, facts.fov_vertical_deg);
  if (!(wide > kWide)) return "";
  return fmt::format(
      "the lens was found to be {:.0f} degrees wide by a model that does not hold for fisheyes: if it is "
      "one, "
      "poses are wrong by percents; calibrate it (raysfm camera calibrate) and give its file with --camera",
      wide);
}

Result<void> check_fov(const TrackSettings& settings) {
  if (settings.fov == 0) return {};
  if (!settings.camera.empty()) {
    return bad_input(fmt::format("--fov = {}: not allowed with --camera, which tells it", settings.fov));
  }
  if (settings.fov >= kLeastFov && settings.fov <= kMostFov) return {};
  return bad_input(fmt::format("--fov = {}: must be {} to {} degrees", settings.fov, kLeastFov, kMostFov));
}

Result<FoundLens> find_lens(const TrackSettings& settings, Input input, const TrackCallbacks& callbacks,
                            ZoomedStretch* zoom) {
  if (auto r = check_single(settings, input); !r) return r.error();
  const bool is_device = input.layout == "device";
  if (is_device && settings.fov == 0) {
    return bad_input(
        fmt::format("{}: a device is not read twice: its lens is not found from the footage; "
                    "give --camera or --fov",
                    settings.inputs[0]));
  }
  std::optional<FoundLens> told;
  if (settings.fov > 0) told = lens_of_fov(settings.fov, *input.streams[0]);
  Telling telling{{}, "a device is not read twice"};
  if (!is_device) {
    if (callbacks.ready) {
      if (auto r = callbacks.ready(); !r) return r.error();
    }
    tell(callbacks.event, Event::Level::kInfo, "no camera file: the lens is looked for in the footage");
    auto reader = TrackReader::open(std::move(input), SolveSettings().features, settings.threads);
    if (!reader) return reader.error();
    Result<Telling> asked = ask_footage(settings, **reader, callbacks, zoom);
    if (!asked) return asked.error();
    telling = *std::move(asked);
    if (!is_sure(telling.lens) && telling.turned) telling.lens = telling.turned;
    if (!telling.lens && !told && !callbacks.stopped()) {
      telling.lens = ask_tracking(settings, (*reader)->source(), telling.vague, callbacks);
    }
  }
  if (!telling.lens && !told) {
    return no_reconstruction(
        fmt::format("{}: the lens is not told by the footage: {}; give --camera or --fov", settings.inputs[0],
                    telling.reason));
  }
  if (telling.lens && told) tell(callbacks.event, Event::Level::kWarning, disagreement(*telling.lens, *told));
  FoundLens lens = telling.lens ? *std::move(telling.lens) : *std::move(told);
  if (!telling.lens) lens.origin.not_told = telling.reason;
  lens.origin.told_fov_deg = settings.fov;
  return lens;
}

std::optional<FoundLens> own_lens(const TrackSettings& settings, Input input, bool is_alone,
                                  const TrackCallbacks& callbacks) {
  input.streams.resize(1);
  auto reader = TrackReader::open(std::move(input), SolveSettings().features, settings.threads);
  if (!reader) return std::nullopt;
  ZoomedStretch zoom;
  Result<Telling> asked = ask_footage(settings, **reader, callbacks, &zoom);
  if (!asked || zoom.is_seen() || callbacks.stopped()) return std::nullopt;
  if (!asked->lens && is_alone)
    return lens_by_tracking(settings, (*reader)->source(), asked->vague, callbacks);
  return asked->lens;
}

}  // namespace raysfm
