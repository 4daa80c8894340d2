#include "raysfm/api/solve_tracks.h"

#include <fmt/format.h>

#include <algorithm>
#include <thread>

#include "raysfm/api/view_stream.h"
#include "raysfm/io/frame_source.h"
#include "raysfm/io/image_file.h"

namespace raysfm {
namespace {

constexpr size_t kFollowed = 3;  // key frames
// A key frame is made when corners have moved by this part of the image's width, or when fewer than this
// part of the corners is found again.
constexpr float kKeyframeMotion = 0.05f;
constexpr double kKeyframeShare = 0.5;

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
}

}  // namespace

bool TrackJoiner::keyframe_needed(int matched) const {
  const PairTracker& newest = followed_.front().tracker;
  const CameraView& base = newest.base();
  return newest.median_displacement() > kKeyframeMotion * static_cast<float>(base.image.width()) ||
         matched < kKeyframeShare * base.features.size();
}

void TrackJoiner::make_keyframe(const ViewPtr& view, std::vector<int> track_of_corner) {
  const CameraView& camera = view->cameras[0];
  for (int i = 0; i < camera.features.size(); ++i) {
    if (track_of_corner[i] >= 0) continue;
    const Eigen::Vector2f& pixel = camera.features.pixels[i];
    track_of_corner[i] = input_.tracks.point_count++;
    last_frame_.push_back(frames() - 1);
    input_.rgb.push_back(color_at(camera, pixel));
    input_.tracks.add(frames() - 1, track_of_corner[i], pixel.cast<double>());
  }
  input_.keyframe.back() = 1;
  followed_.push_front({PairTracker(view, 0), std::move(track_of_corner)});
  if (followed_.size() > kFollowed) followed_.pop_back();
}

void TrackJoiner::add(const ViewPtr& view) {
  const CameraView& camera = view->cameras[0];
  input_.timestamps.push_back(view->timestamp);
  input_.names.push_back(view->name);
  input_.keyframe.push_back(0);
  input_.tracks.image_size = {camera.image.width(), camera.image.height()};
  std::vector<int> track_of_corner(camera.features.size(), -1);
  int matched_with_newest = 0;
  for (Followed& followed : followed_) {
    const int matched = followed.tracker.advance(view);
    if (&followed == &followed_.front()) matched_with_newest = matched;
    const std::vector<int>& matches = followed.tracker.matches(followed.tracker.views() - 1);
    for (size_t i = 0; i < matches.size(); ++i) {
      const int corner = matches[i], track = followed.track[i];
      // What the newer key frame says of a corner or a track counts.
      if (corner < 0 || track_of_corner[corner] >= 0 || last_frame_[track] == frames() - 1) continue;
      track_of_corner[corner] = track;
      last_frame_[track] = frames() - 1;
      input_.tracks.add(frames() - 1, track, camera.features.pixels[corner].cast<double>());
    }
  }
  if (followed_.empty() || keyframe_needed(matched_with_newest)) {
    make_keyframe(view, std::move(track_of_corner));
  }
}

SolveInput TrackJoiner::finish() {
  keep_seen_twice(&input_);
  return std::move(input_);
}

Result<SolveInput> tracks_from_video(const SolveSettings& settings, const SolveCallbacks& callbacks) {
  Result<Input> input =
      open_input({settings.input}, {.fps = settings.fps, .mono = true, .ignore_calibration = true});
  if (!input) return input.error();
  const auto tell = [&](Event::Level level, const std::string& message) {
    if (callbacks.event && !message.empty()) callbacks.event({level, message});
  };
  if (input->calibration_file) {
    tell(Event::Level::kInfo,
         fmt::format("{} is not used, the lens is found from the images", input->calibration_file->string()));
  }
  FrameSource& source = *input->streams[0];
  CameraInput camera;
  camera.harris.max_features = settings.features;
  GrayImage mask;
  if (input->mask) {
    Result<GrayImage> read = read_mask(*input->mask, source.width(), source.height());
    if (!read) return read.error();
    mask = *std::move(read);
    camera.harris.mask = mask.view();
  }
  if (callbacks.ready) {
    if (auto r = callbacks.ready(); !r) return r.error();
  }
  const int threads =
      settings.threads > 0 ? settings.threads : static_cast<int>(std::thread::hardware_concurrency());
  input->streams.resize(1);
  ViewStream stream(input->streams, {camera}, threads);
  TrackJoiner joiner;
  bool interrupted = false;
  while (!(interrupted = callbacks.stop && callbacks.stop->load())) {
    const Result<ViewPtr> view = stream.next();
    if (!view) return view.error();
    if (!*view) break;
    joiner.add(*view);
    if (callbacks.progress) callbacks.progress(joiner.frames(), source.frame_count());
  }
  if (!interrupted) tell(Event::Level::kWarning, source.note());
  if (joiner.frames() == 0) return bad_input(fmt::format("{}: no frames", source.description()));
  SolveInput result = joiner.finish();
  result.interrupted = interrupted;
  return result;
}

}  // namespace raysfm
