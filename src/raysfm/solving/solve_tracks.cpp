#include "raysfm/solving/solve_tracks.h"

#include <fmt/format.h>

#include <algorithm>
#include <span>

#include "raysfm/core/median.h"
#include "raysfm/core/thread_pool.h"
#include "raysfm/frames/frame_source.h"
#include "raysfm/frames/image_file.h"
#include "raysfm/streams/view_stream.h"

namespace raysfm {
namespace {

constexpr size_t kFollowed = 3;  // key frames
// A key frame is made when corners have moved by this part of the image's longer side, or when fewer than
// this part of the corners is found again.
constexpr float kKeyframeMotion = 0.05f;
constexpr double kKeyframeShare = 0.5;
// An image with fewer corners is no key frame: black, or blurred. One with so many times the corners of the
// newest key frame is the next.
constexpr int kLeastCorners = 30;
constexpr int kManyMore = 4;
// Of the corners of a view that are followed by themselves, and the least views that see one.
constexpr int kEveryCorner = 3;
constexpr size_t kSeenOften = 3;

void keep_seen_twice(SolveInput* input) {
  PointTracks& tracks = input->tracks;
  std::vector<int> seen(tracks.point_count, 0), number(tracks.point_count, -1);
  for (const int point : tracks.point) ++seen[point];
  int kept = 0;
  for (int i = 0; i < tracks.point_count; ++i) {
    if (seen[i] < 2) continue;
    input->rgb[kept] = input->rgb[i];
    number[i] = kept++;
  }
  input->rgb.resize(kept);
  PointTracks few;
  few.image_count = static_cast<int>(input->names.size());
  few.point_count = kept;
  few.image_size = tracks.image_size;
  for (int k = 0; k < tracks.size(); ++k) {
    if (number[tracks.point[k]] >= 0) few.add(tracks.image[k], number[tracks.point[k]], tracks.pixel[k]);
  }
  tracks = std::move(few);
  for (DescribedImage& image : input->described) {
    size_t described = 0;
    for (size_t i = 0; i < image.points.size(); ++i) {
      if (number[image.points[i]] < 0) continue;
      image.points[described] = number[image.points[i]];
      image.descriptors[described++] = image.descriptors[i];
    }
    image.points.resize(described);
    image.descriptors.resize(described);
  }
}

CameraInput corners_of(const GrayImage& mask, int features) {
  CameraInput camera;
  camera.harris.max_features = features;
  camera.harris.mask = mask.view();
  return camera;
}

// A corner in the views in which it was seen.
struct CornerInView {
  int view;
  Eigen::Vector2f pixel;
};
using CornerTrack = std::vector<CornerInView>;

// Adds what the view that the tracker has seen last shows of its corners, aligned with them.
void add_aligned(const PairTracker& tracker, const CameraView& view, int number, CornerAligner* aligner,
                 std::span<CornerTrack> tracks) {
  const std::vector<int>& matches = tracker.matches(tracker.views() - 1);
  std::vector<int> corners;
  std::vector<Eigen::Vector2f> in_base, in_view;
  std::vector<uint8_t> octaves;
  for (size_t i = 0; i < matches.size(); ++i) {
    if (matches[i] < 0) continue;
    corners.push_back(static_cast<int>(i));
    in_base.push_back(tracks[i][0].pixel);
    in_view.push_back(view.features.pixels[matches[i]]);
    octaves.push_back(view.features.octaves[matches[i]]);
  }
  std::vector<PatchAlignment> aligned;
  aligner->align(*tracker.base().octaves, in_base, *view.octaves, in_view, octaves, view.width, view.height,
                 &aligned);
  for (size_t k = 0; k < corners.size(); ++k) {
    if (aligned[k].converged) tracks[corners[k]].push_back({number, aligned[k].pixel});
  }
}

}  // namespace

bool TrackJoiner::keyframe_needed(const CameraView& camera, int matched) const {
  if (camera.features.size() < kLeastCorners) return false;
  if (followed_.empty()) return true;
  const PairTracker& newest = followed_.front().tracker;
  const CameraView& base = newest.base();
  if (camera.features.size() > kManyMore * base.features.size()) return true;
  return newest.median_displacement() > kKeyframeMotion * static_cast<float>(base.longer_side()) ||
         matched < kKeyframeShare * base.features.size();
}

void TrackJoiner::make_keyframe(const ViewPtr& view, std::vector<Sighting> sightings) {
  const CameraView& camera = view->cameras[0];
  Followed followed{PairTracker(view, 0), {}, {}};
  for (int i = 0; i < camera.features.size(); ++i) {
    Sighting& seen = sightings[i];
    if (seen.track < 0) {
      seen = {input_.tracks.point_count++, camera.features.pixels[i]};
      last_frame_.push_back(frames() - 1);
      input_.rgb.push_back(camera.rgb[i]);
      input_.tracks.add(frames() - 1, seen.track, seen.place.cast<double>());
    }
    followed.track.push_back(seen.track);
    followed.place.push_back(seen.place);
  }
  describe(camera, sightings);
  input_.keyframe.back() = 1;
  ++keyframes_;
  corner_sides_.push_back(octave_side(camera.octaves->first()));
  followed_.push_front(std::move(followed));
  if (followed_.size() > kFollowed) followed_.pop_back();
}

// What the corners of the newest frame, whose tracks are known, look like.
void TrackJoiner::describe(const CameraView& camera, const std::vector<Sighting>& sightings) {
  describer_.describe(*camera.octaves, camera.features.pixels, camera.features.octaves, &descriptors_);
  std::vector<std::pair<int, int>> order;  // (track, place among the descriptors)
  for (int i = 0; i < descriptors_.size(); ++i)
    order.emplace_back(sightings[descriptors_.corners[i]].track, i);
  std::ranges::sort(order);
  DescribedImage& image = input_.described.emplace_back();
  image.image = frames() - 1;
  for (const auto& [track, i] : order) {
    image.points.push_back(track);
    image.descriptors.push_back(descriptors_.descriptors[i]);
  }
}

// The tracks of a key frame in the newest frame, which its tracker has matched.
void TrackJoiner::follow(const Followed& followed, const CameraView& camera,
                         std::vector<Sighting>* sightings) {
  const std::vector<int>& matches = followed.tracker.matches(followed.tracker.views() - 1);
  matched_.clear(), in_base_.clear(), in_frame_.clear(), octaves_.clear();
  for (size_t i = 0; i < matches.size(); ++i) {
    // What the newer key frame says of a corner or a track counts.
    if (matches[i] < 0 || (*sightings)[matches[i]].track >= 0) continue;
    if (last_frame_[followed.track[i]] == frames() - 1) continue;
    matched_.push_back(static_cast<int>(i));
    in_base_.push_back(followed.place[i]);
    in_frame_.push_back(camera.features.pixels[matches[i]]);
    octaves_.push_back(camera.features.octaves[matches[i]]);
  }
  aligner_.align(*followed.tracker.base().octaves, in_base_, *camera.octaves, in_frame_, octaves_,
                 camera.width, camera.height, &aligned_);
  for (size_t k = 0; k < matched_.size(); ++k) {
    if (!aligned_[k].converged) continue;
    const int track = followed.track[matched_[k]];
    (*sightings)[matches[matched_[k]]] = {track, aligned_[k].pixel};
    last_frame_[track] = frames() - 1;
    input_.tracks.add(frames() - 1, track, aligned_[k].pixel.cast<double>());
  }
}

void TrackJoiner::add(const ViewPtr& whole) {
  input_.timestamps.push_back(whole->timestamp);
  input_.names.push_back(whole->name);
  input_.keyframe.push_back(0);
  input_.defects.push_back(whole->defect);
  input_.same_as.push_back(whole->same_as >= 0 ? newest_picture_ : -1);
  if (!whole->defect.empty() || whole->same_as >= 0) return;
  marks_.watch(*whole);
  const ViewPtr view = marks_.without(whole);
  newest_picture_ = frames() - 1;
  ++pictures_;
  const CameraView& camera = view->cameras[0];
  input_.tracks.image_size = {camera.width, camera.height};
  std::vector<Sighting> sightings(camera.features.size());
  int matched_with_newest = 0;
  for (Followed& followed : followed_) {
    const int matched = followed.tracker.advance(view);
    if (&followed == &followed_.front()) matched_with_newest = matched;
    follow(followed, camera, &sightings);
  }
  if (keyframe_needed(camera, matched_with_newest)) {
    make_keyframe(view, std::move(sightings));
  }
}

void stretch_images(const Eigen::Vector2d& factors, PointTracks* tracks) {
  if (factors == Eigen::Vector2d::Ones()) return;
  const Eigen::Vector2d half(0.5, 0.5);
  tracks->image_size = tracks->image_size.cwiseProduct(factors);
  for (Eigen::Vector2d& p : tracks->pixel) p = (p + half).cwiseProduct(factors) - half;
}

PointTracks corner_tracks(std::span<const ViewPtr> views, int camera) {
  const int count = static_cast<int>(views.size());
  PointTracks tracks;
  tracks.image_count = count;
  if (count == 0) return tracks;
  tracks.image_size = {views[0]->cameras[camera].width, views[0]->cameras[camera].height};
  CornerAligner aligner;
  for (const int base : {0, count / 3}) {
    PairTracker tracker(views[base], camera, kEveryCorner);
    std::vector<CornerTrack> corners;
    for (const Eigen::Vector2f& pixel : tracker.base().features.pixels) corners.push_back({{base, pixel}});
    for (int v = base + 1; v < std::min(count, base + (2 * count + 2) / 3); ++v) {
      tracker.advance(views[v]);
      add_aligned(tracker, views[v]->cameras[camera], v, &aligner, corners);
    }
    for (const CornerTrack& corner : corners) {
      if (corner.size() < kSeenOften) continue;
      for (const CornerInView& seen : corner)
        tracks.add(seen.view, tracks.point_count, seen.pixel.cast<double>());
      ++tracks.point_count;
    }
  }
  return tracks;
}

// What was seen of them before they were known for what they are.
void TrackJoiner::forget_marks() {
  PointTracks& tracks = input_.tracks;
  PointTracks rest;
  rest.image_count = tracks.image_count;
  rest.point_count = tracks.point_count;
  rest.image_size = tracks.image_size;
  for (int k = 0; k < tracks.size(); ++k) {
    if (!marks_.covers(0, tracks.pixel[k].cast<float>()))
      rest.add(tracks.image[k], tracks.point[k], tracks.pixel[k]);
  }
  tracks = std::move(rest);
}

SolveInput TrackJoiner::finish() {
  if (!marks_.empty()) forget_marks();
  keep_seen_twice(&input_);
  if (!corner_sides_.empty()) input_.corner_side = median_of(&corner_sides_);
  return std::move(input_);
}

TrackReader::TrackReader(Input input, GrayImage mask, int features, int threads)
    : input_(std::move(input)),
      mask_(std::move(mask)),
      stream_(input_.streams, ViewMaker({corners_of(mask_, features)}), threads) {}

Result<std::unique_ptr<TrackReader>> TrackReader::open(Input input, int features, int threads) {
  const FrameSource& source = *input.streams[0];
  GrayImage mask;
  if (input.mask) {
    Result<GrayImage> read = read_mask(*input.mask, source.width(), source.height());
    if (!read) return read.error();
    mask = *std::move(read);
  }
  input.streams.resize(1);
  return std::unique_ptr<TrackReader>(
      new TrackReader(std::move(input), std::move(mask), features, thread_count(threads)));
}

Result<SolveInput> TrackReader::read(const std::function<bool(const TrackJoiner&)>& go_on) {
  TrackJoiner joiner;
  StageTiming detect, follow;
  while (go_on(joiner)) {
    const Result<ViewPtr> view = stream_.next();
    if (!view) return view.error();
    if (!*view) break;
    detect.add((*view)->detect_ms);
    const ScopedTimer timer(follow);
    joiner.add(*view);
  }
  SolveInput result = joiner.finish();
  result.stages = {{"detect", detect}, {"follow", follow}};
  return result;
}

std::string TrackReader::notes() const {
  const std::string of_source = source().note(), of_stream = stream_.note();
  return of_source + (of_source.empty() || of_stream.empty() ? "" : "; ") + of_stream;
}

Result<SolveInput> tracks_from_video(const SolveSettings& settings, const SolveCallbacks& callbacks) {
  Result<Input> input = open_input({settings.input}, {.fps = settings.fps,
                                                      .mono = true,
                                                      .ignore_calibration = true,
                                                      .threads = settings.threads,
                                                      .range = settings.range});
  if (!input) return input.error();
  if (input->calibration_file) {
    tell(callbacks.event, Event::Level::kInfo,
         fmt::format("{} is not used, the lens is found from the images", input->calibration_file->string()));
  }
  auto reader = TrackReader::open(*std::move(input), settings.features, settings.threads);
  if (!reader) return reader.error();
  if (callbacks.ready) {
    if (auto r = callbacks.ready(); !r) return r.error();
  }
  const FrameSource& source = (*reader)->source();
  if (source.pixel_aspect() != 1) {
    tell(callbacks.event, Event::Level::kWarning,
         fmt::format(
             "{}: pixels are {:.3g} times as wide as high, but taken for square, so that the lens is wrong: "
             "raysfm track minds it, or scale the video first",
             settings.input, source.pixel_aspect()));
  }
  bool interrupted = false;
  Result<SolveInput> result = (*reader)->read([&](const TrackJoiner& joiner) {
    if (callbacks.progress && joiner.frames() > 0) {
      callbacks.progress("frame", joiner.frames(), source.frame_count());
    }
    interrupted = callbacks.stopped();
    return !interrupted;
  });
  if (!result) return result;
  if (!interrupted) tell(callbacks.event, Event::Level::kWarning, (*reader)->notes());
  if (result->names.empty()) return bad_input(fmt::format("{}: no frames", source.description()));
  result->interrupted = interrupted;
  result->stages.insert(result->stages.begin(), {"decode", (*reader)->finish()});
  return result;
}

}  // namespace raysfm
