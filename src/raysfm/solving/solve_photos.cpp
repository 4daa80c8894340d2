#include "raysfm/solving/solve_photos.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <memory>
#include <optional>
#include <span>

#include "raysfm/camera/camera_class.h"
#include "raysfm/camera_files/camera_file.h"
#include "raysfm/core/median.h"
#include "raysfm/core/timer.h"
#include "raysfm/frames/frame_source.h"
#include "raysfm/matching/photo_features.h"
#include "raysfm/photos/photo_lenses.h"
#include "raysfm/photos/photo_pairs.h"
#include "raysfm/photos/photo_points.h"
#include "raysfm/projective/view_pair.h"
#include "raysfm/solving/solve_tracks.h"

namespace raysfm {
namespace {

constexpr int kMinAgreeing = 40;
// Of a photo: of few, all of which are compared, and of many.
constexpr int kFeaturesOfFew = 5000, kFeaturesOfMany = 2500;

Error refused(const SolveSettings& settings, const std::string& why) {
  return bad_input(fmt::format("{}: {}; raysfm track takes a video of it", settings.camera, why));
}

Result<void> read_photos(FrameSource& source, const std::atomic<bool>* stop, std::vector<TakenPhoto>* photos,
                         SolveInput* input) {
  PhotoPoints& points = input->photo_points;
  const bool few = source.frame_count() >= 0 && source.frame_count() <= kMostInAllPairs;
  const int most_features = few ? kFeaturesOfFew : kFeaturesOfMany;
  while (!(input->interrupted = stop && stop->load())) {
    Result<std::optional<InputFrame>> next = source.next();
    if (!next) return next.error();
    if (!*next) break;
    const InputFrame& frame = **next;
    if (auto r = points.features->add(frame.gray.view(), most_features); !r) return r;
    points.first.push_back(static_cast<int>(points.rgb.size()));
    for (const Eigen::Vector2d& p : points.features->pixels(points.features->photos() - 1)) {
      const int x = std::clamp(static_cast<int>(p.x() + 0.5), 0, frame.gray.width() - 1);
      const int y = std::clamp(static_cast<int>(p.y() + 0.5), 0, frame.gray.height() - 1);
      points.rgb.push_back(frame.colors.at(x, y, frame.gray.row(y)[x]));
    }
    input->timestamps.push_back(frame.timestamp);
    input->names.push_back(frame.name);
    input->keyframe.push_back(1);
    input->defects.push_back(frame.defect);
    TakenPhoto& taken = photos->emplace_back();
    taken.name = frame.name;
    taken.size = {frame.gray.width(), frame.gray.height()};
    if (frame.defect.empty()) taken.exif = read_exif(frame.file);
    if (frame.defect.empty()) {
      input->sizes.emplace_back(frame.gray.width(), frame.gray.height());
    } else {
      input->sizes.emplace_back(source.width(), source.height());
    }
    if (input->sizes.size() > kMaxPhotos) {
      return bad_input(fmt::format("{}: more than {} images; allowed as photos: at most {}",
                                   source.description(), kMaxPhotos, kMaxPhotos));
    }
  }
  return {};
}

// One size for all images: that of the largest.
void settle_size(SolveInput* input) {
  Eigen::Vector2i largest(0, 0);
  for (const Eigen::Vector2i& size : input->sizes) largest = largest.cwiseMax(size);
  const bool alike = std::ranges::all_of(input->sizes, [&](const auto& size) { return size == largest; });
  input->tracks.image_size = largest.cast<double>();
  if (alike) input->sizes.clear();
}

// Tracks of the points that are one.
void collect_tracks(SolveInput* input) {
  const PhotoPoints& points = input->photo_points;
  PointTracks tracks;
  tracks.image_size = input->tracks.image_size;
  tracks.image_count = points.features->photos();
  tracks.point_count = points.tracks;
  input->rgb.resize(points.tracks);
  for (int j = 0, i = 0; j < tracks.image_count; ++j) {
    for (const Eigen::Vector2d& pixel : points.features->pixels(j)) {
      const int point = i++, track = points.track[point];
      if (track < 0) continue;
      tracks.add(j, track, pixel + input->shift(j));
      input->rgb[track] = points.rgb[point];
    }
  }
  input->tracks = std::move(tracks);
}

StageTiming& stage(const std::string& name, SolveInput* input) {
  const auto there = std::ranges::find(input->stages, name, [](const auto& stage) { return stage.first; });
  return there == input->stages.end() ? input->stages.emplace_back(name, StageTiming{}).second
                                      : there->second;
}

// Tracks by the pairs that are worth a comparison, and have a photo that has no pose; along with those there
// are.
void compare_photos(const std::string& stage_name, std::span<const uint8_t> posed, float max_ratio,
                    const SolveSettings& settings, const std::atomic<bool>* stop, SolveInput* input) {
  ThreadPool pool(thread_count(settings.threads) - 1);
  PhotoPoints& points = input->photo_points;
  if (!points.pairs) {
    auto pairs = [&] {
      const ScopedTimer timer(stage("retrieve", input));
      return pairs_to_compare(*points.features, &pool);
    }();
    const ScopedTimer timer(stage("match", input));
    points.pairs =
        std::make_shared<MatchedPairs>(match_pairs(*points.features, std::move(pairs), stop, &pool));
  }
  {
    const ScopedTimer timer(stage(stage_name, input));
    const auto same = compare_pairs(*points.features, *points.pairs,
                                    {.camera = input->camera ? &*input->camera : nullptr,
                                     .max_error_px = settings.max_error,
                                     .max_ratio = max_ratio,
                                     .posed = posed,
                                     .seed = settings.seed,
                                     .stop = stop},
                                    &pool);
    join_same_points(points.pairs->photos, same, &points);
  }
  collect_tracks(input);
}

// Matches that one shift of the image explains.
int count_still(const PairMatches& matches, double max_error) {
  std::vector<double> u, v;
  for (size_t i = 0; i < matches.a.size(); ++i) {
    u.push_back(matches.b[i].x() - matches.a[i].x());
    v.push_back(matches.b[i].y() - matches.a[i].y());
  }
  if (u.empty()) return 0;
  const Eigen::Vector2d shift(median_of(&u), median_of(&v));
  int count = 0;
  for (size_t i = 0; i < matches.a.size(); ++i) {
    count += (matches.b[i] - matches.a[i] - shift).norm() < max_error;
  }
  return count;
}

// Images of which too few corners agree with one motion since the image before, as in a video they do.
int poor_neighbours(const SolveInput& video, const SolveSettings& settings, const std::atomic<bool>* stop) {
  const ImageObservations observations(video.tracks);
  int poor = 0;
  for (int j = 1; j < video.tracks.image_count && !(stop && stop->load()); ++j) {
    const PairMatches matches = observations.matches(j - 1, j);
    ViewPair pair;
    const bool found =
        fundamental_ransac(matches, settings.max_error, 500, settings.seed, static_cast<uint64_t>(j), &pair);
    // A camera that stands still has no epipolar geometry.
    const int agreeing = std::max(found ? pair.inliers : 0, count_still(matches, settings.max_error));
    poor += agreeing < kMinAgreeing;
  }
  return poor;
}

// Why images that no video has are photos; empty where they all have one size, or cannot be read.
std::string differing_sizes(const SolveSettings& settings) {
  Result<Input> opened = open_input({settings.input}, {.fps = settings.fps,
                                                       .mono = true,
                                                       .ignore_calibration = true,
                                                       .threads = settings.threads,
                                                       .range = settings.range});
  if (!opened) return "";
  FrameSource& source = *opened->streams[0];
  source.allow_any_size();
  for (;;) {
    const Result<std::optional<InputFrame>> frame = source.next();
    if (!frame || !*frame) return "";
    const GrayImage& image = (*frame)->gray;
    if (!(*frame)->defect.empty()) continue;
    if (image.width() == source.width() && image.height() == source.height()) continue;
    return fmt::format("{} is {}x{}, the first image {}x{}", (*frame)->name, image.width(), image.height(),
                       source.width(), source.height());
  }
}

}  // namespace

Result<Camera> known_camera(const SolveSettings& settings, const Input* opened, const EventSink& event) {
  std::string note;
  Result<Rig> rig = read_camera_file(settings.camera, &note);
  if (!rig) return rig.error();
  tell(event, Event::Level::kWarning, note);
  if (rig->cameras.size() != 1) return refused(settings, fmt::format("{} cameras", rig->cameras.size()));
  if (opened) {
    rig = rig_for_streams(*std::move(rig), opened->streams, &note, true);
    if (!rig) return bad_input(fmt::format("{}: {}", settings.camera, rig.error().message));
  }
  Camera camera = rig->cameras[0];
  camera.rig_from_cam = Rigid3{};
  camera.shutter = {};
  if (camera.roi.w > 0) return refused(settings, "roi: the camera is a part of the image");
  if (!camera.mask_path.empty()) {
    tell(event, Event::Level::kWarning, fmt::format("{}: the mask is not used", settings.camera));
  }
  if (!camera.can_project()) return refused(settings, "the model cannot project");
  if (camera_class(Rig{{camera}}) != CameraClass::kCentral) return refused(settings, "no single viewpoint");
  return camera;
}

Result<SolveInput> tracks_from_images(const SolveSettings& settings, const SolveCallbacks& callbacks) {
  constexpr const char* kPhotos = "taken for photos, every one is compared with every other: ";
  if (settings.images == "photos") return tracks_from_photos(settings, callbacks);
  Result<SolveInput> video = tracks_from_video(settings, callbacks);
  if (settings.images == "video") return video;
  if (!video) return video;
  if (std::ranges::any_of(video->defects, [](const std::string& defect) { return !defect.empty(); })) {
    const std::string why = differing_sizes(settings);
    if (!why.empty()) {
      tell(callbacks.event, Event::Level::kInfo, kPhotos + why);
      return tracks_from_photos(settings, callbacks);
    }
  }
  if (video->interrupted || video->tracks.image_count < 2 || video->tracks.image_count > kMaxAutoPhotos ||
      !no_motion(*video).empty()) {
    return video;
  }
  const int poor = poor_neighbours(*video, settings, callbacks.stop);
  const int images = video->tracks.image_count;
  // A long video may have its breaks.
  if (poor > 0 && (images <= kFewImages || 4 * poor >= images)) {
    tell(callbacks.event, Event::Level::kInfo,
         fmt::format("{}{} of {} have fewer than {} corners that agree with the image before", kPhotos, poor,
                     images, kMinAgreeing));
    return tracks_from_photos(settings, callbacks);
  }
  return video;
}

Result<SolveInput> tracks_from_photos(const SolveSettings& settings, const SolveCallbacks& callbacks) {
  Result<Input> opened = open_input({settings.input}, {.fps = settings.fps,
                                                       .mono = true,
                                                       .ignore_calibration = true,
                                                       .threads = settings.threads,
                                                       .range = settings.range});
  if (!opened) return opened.error();
  if (callbacks.ready) {
    if (auto r = callbacks.ready(); !r) return r.error();
  }
  SolveInput input;
  input.in_order = false;
  if (!settings.camera.empty()) {
    Result<Camera> camera = known_camera(settings, &*opened, callbacks.event);
    if (!camera) return camera.error();
    input.camera = *std::move(camera);
  }
  Result<std::unique_ptr<PhotoFeatures>> features = make_photo_features();
  if (!features) return features.error();
  input.photo_points.features = *std::move(features);
  std::vector<TakenPhoto> photos;
  if (!input.camera) opened->streams[0]->allow_any_size();
  if (auto r = read_photos(*opened->streams[0], callbacks.stop, &photos, &input); !r) return r.error();
  settle_size(&input);
  if (!input.camera) {
    input.exif = lenses_by_exif(photos);
    tell_exif(input.exif, callbacks.event);
    input.lens_of_image = numbers_of_lenses(photos);
  }
  compare_photos("compare", std::vector<uint8_t>(photos.size(), 0), kClearRatio, settings, callbacks.stop,
                 &input);
  input.interrupted = input.interrupted || callbacks.stopped();
  return input;
}

std::optional<SolveInput> with_loose_matches(const SolveInput& input, std::span<const uint8_t> posed,
                                             const SolveSettings& settings, const SolveCallbacks& callbacks) {
  if (!input.photo_points.features || callbacks.stopped()) return {};
  int left_out = 0;
  for (size_t j = 0; j < posed.size(); ++j) {
    left_out += !posed[j] && !input.photo_points.features->pixels(static_cast<int>(j)).empty();
  }
  if (left_out == 0) return {};
  tell(callbacks.event, Event::Level::kInfo,
       fmt::format("{} of {} photos are compared again, less strictly", left_out, posed.size()));
  SolveInput loose = input;
  compare_photos("compare again", posed, kLooseRatio, settings, callbacks.stop, &loose);
  return loose;
}

}  // namespace raysfm
