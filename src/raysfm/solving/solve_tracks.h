#pragma once

#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "raysfm/features/descriptor.h"
#include "raysfm/frames/frame_source.h"
#include "raysfm/matching/corner_aligner.h"
#include "raysfm/matching/pair_tracker.h"
#include "raysfm/solving/solve_input.h"
#include "raysfm/streams/view_stream.h"
#include "raysfm/uncalibrated/reconstruct.h"
#include "raysfm/views/fixed_marks.h"

namespace raysfm {

// Joins the corners of a video to tracks, before any geometry is known. Key frames are chosen where the image
// has moved far enough; the corners of the latest key frames are followed through every frame, their patches
// aligned with those of the key frame, and a corner of a key frame that belongs to no track begins one.
class TrackJoiner {
 public:
  // The next frame; views of one camera. One that repeats another sees no tracks: that one counts for it.
  void add(const ViewPtr& view);
  int frames() const { return static_cast<int>(input_.names.size()); }
  // Those that repeat no other.
  int pictures() const { return pictures_; }
  int keyframes() const { return keyframes_; }

  // Tracks that two frames see, in the order in which they began.
  SolveInput finish();

 private:
  struct Followed {
    PairTracker tracker;
    std::vector<int> track;              // of each corner of its base
    std::vector<Eigen::Vector2f> place;  // of that track in its base
  };
  // What a frame shows of the tracks, by its corners; track -1: none.
  struct Sighting {
    int track = -1;
    Eigen::Vector2f place = Eigen::Vector2f::Zero();
  };

  bool keyframe_needed(const CameraView& camera, int matched) const;
  void follow(const Followed& followed, const CameraView& camera, std::vector<Sighting>* sightings);
  void make_keyframe(const ViewPtr& view, std::vector<Sighting> sightings);
  void describe(const CameraView& camera, const std::vector<Sighting>& sightings);

  void forget_marks();

  SolveInput input_;
  FixedMarks marks_;
  int keyframes_ = 0, pictures_ = 0;
  std::vector<double> corner_sides_;  // of key frames
  int newest_picture_ = -1;           // the newest frame that repeats no other
  std::deque<Followed> followed_;     // the newest key frame first
  std::vector<int> last_frame_;       // that saw a track
  CornerAligner aligner_;
  Describer describer_;
  DescriptorSet descriptors_;
  std::vector<int> matched_;  // corners of the base
  std::vector<Eigen::Vector2f> in_base_, in_frame_;
  std::vector<uint8_t> octaves_;  // of in_frame_
  std::vector<PatchAlignment> aligned_;
};

// Corners of two of the views, each followed through two thirds of all views by their looks alone, and where
// their patches lie there. `views`: in the order of time, with corners.
PointTracks corner_tracks(std::span<const ViewPtr> views, int camera);

// Tracks of images that were stretched by these factors: what tells a lens takes pixels for square, and for
// as large as corners are exact.
void stretch_images(const Eigen::Vector2d& factors, PointTracks* tracks);

// The tracks of a video of one camera, or of images in order, stretch by stretch.
class TrackReader {
 public:
  // The first stream of the input, with the mask that lies beside it. Errors: bad input.
  static Result<std::unique_ptr<TrackReader>> open(Input input, int features, int threads);
  TrackReader(const TrackReader&) = delete;  // the views look at the mask
  TrackReader& operator=(const TrackReader&) = delete;

  // Tracks of the next frames, for as long as there are any and `go_on`, asked before each of them, wants
  // more; numbers of images begin at 0 each time. Errors: bad input.
  Result<SolveInput> read(const std::function<bool(const TrackJoiner&)>& go_on);

  const FrameSource& source() const { return *input_.streams[0]; }
  // What the user should know though it is no error, empty where there is nothing; once the end was reached.
  std::string notes() const;
  // Ends reading, wherever it is, and tells the time that decoding took.
  const StageTiming& finish() { return stream_.finish(); }

 private:
  TrackReader(Input input, GrayImage mask, int features, int threads);

  Input input_;
  GrayImage mask_;
  ViewStream stream_;
};

// Tracks of a video or of images in order, without a calibration. Errors: bad input.
Result<SolveInput> tracks_from_video(const SolveSettings& settings, const SolveCallbacks& callbacks);

}  // namespace raysfm
