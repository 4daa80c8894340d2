#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raysfm/api/track.h"
#include "raysfm/calibration/rig_parameters.h"
#include "raysfm/frames/frame_source.h"
#include "raysfm/uncalibrated/reconstruct.h"
#include "raysfm/views/tracking_rig.h"
#include "raysfm/views/view_maker.h"

namespace raysfm {

// A lens that no camera file told.
struct FoundLens {
  Rig rig;  // its camera, of the size of the frames, its pixels as wide as the input says; or all cameras
  CalibrationPrior prior;  // how far off it may be
  LensOrigin origin;
  bool told_apart = false;  // a perspective lens and one of another model were compared
  bool is_guess = false;    // only what its map says of it is asked for
  bool is_aside = false;    // its optical axis is farther from the middle of the images than is believed

  const Camera& camera() const { return rig.cameras[0]; }
};

// The one lens that was found in the footage, from so large a part of the images that it was looked for in.
// `first_frame`: that of the first image.
FoundLens lens_of_stretch(const UncalibratedReconstruction& found, const PointTracks& tracks, int first_frame,
                          double posed);

// What there is to say of a lens that the footage tells badly, for a map that does not tell it either; empty
// of others.
std::string vague_lens_warning(const LensOrigin& origin);

// What there is to say of a lens found by a model with k1 and k2 alone and compared with no other, where it
// is wider than these are good for; empty of others.
std::string wide_lens_warning(const Camera& camera);

// Bad input for a field of view out of range, or one that is told beside a camera file.
Result<void> check_fov(const TrackSettings& settings);

// What find_lens() hears of a zoom.
struct ZoomedStretch {
  int first_frame = -1, last_frame = -1;  // of the stretch that shows it; -1: none does
  double keyframes = 0;                   // of all that is there, as far as the stretch tells
};

// The lens of a video without a camera file: from the first stretch of the footage that tells it well, else
// from the one that tells it best, else from the field of view that the settings tell, else from tracking.
// Reads the input, perhaps to its end. Errors: bad input, where one camera's footage is not what is given or
// it cannot be read twice; no reconstruction, where neither footage nor settings tell the lens, with the
// reason, or when told to stop. `zoom`, set whatever comes out: the stretch that looks as if the camera
// zoomed, if any; none after it is read.
Result<FoundLens> find_lens(const TrackSettings& settings, Input input, const TrackCallbacks& callbacks,
                            ZoomedStretch* zoom);

// Of the size of the frames and as square as their pixels, its principal point in the middle. `focal`:
// pixels.
Camera pinhole_camera(double focal, const FrameSource& source);

// The lens that maps tell which are tracked with others, over the beginning of the footage: from what a
// stretch says of it (`vague`, too little to be told), where the map tells one that is not far from that;
// else from a short and a long focal length, where both end at the same. It minds rolling shutters, which
// find_lens() does not, and needs no start without a lens. None where maps do not agree, or do not tell.
std::optional<FoundLens> lens_by_tracking(const TrackSettings& settings, const FrameSource& source,
                                          const std::optional<FoundLens>& vague,
                                          const TrackCallbacks& callbacks);

// A focal length as corners tell it on whose matching no lens had a say.
struct CornerFocal {
  double focal = 0;  // pixels
  double sigma = 0;  // standard deviation, as a part of it
};

// What corners of a camera of the rig that are followed from view to view by their looks alone say of its
// focal length, given no more of it than its distortion. `views`: in the order of time, with corners. None of
// cameras that are not perspective, and where they hold no lens.
std::optional<CornerFocal> focal_of_corners(std::span<const ViewPtr> views, const Camera& camera, int number,
                                            uint64_t seed);

// How a map explains what a camera of the rig sees.
struct CameraFit {
  int observations = 0;   // that fit it
  double rms = 0;         // of these, pixels
  bool is_bad = false;    // these are far off, or few beside those of others; or most frames have no pose
  bool is_apart = false;  // what it sees, others that should see it too do not
};

// Of each camera, in some of the key frames. `rig`: that of the reconstruction.
std::vector<CameraFit> fits_of_cameras(const Reconstruction& reconstruction, const TrackingRig& rig);

// What speaks against the lens that a camera file gives a camera of the rig.
struct LensDoubt {
  enum class By : uint8_t {
    kMap,      // which tells another focal length, and has it
    kCorners,  // followed without any lens
    kApart,    // what the camera sees, others that should see it too do not
    kMisfit,   // what the camera sees does not fit the map, and nothing tells its focal length
  };
  int camera = 0;
  By by = By::kMap;
  double given = 0, seen = 0;  // focal lengths, pixels; the second is `given` where nothing tells it
  double rms = 0;  // of what fits the map, pixels, where that is far off; 0: it is not, or little does
};

// Whether the footage tells the focal length of every camera that has one.
bool tells_focals(const std::vector<CalibrationNumber>& calibration);

// The cameras whose lens is hardly the one that was given: where the map told another focal length, or told
// none and corners do, or these do not tell either and the map explains badly what the camera sees; or where
// cameras that should see the same do not. What a map is made of was chosen by the lens: where that is far
// off, the map may say nothing against it. `keyframes`: the newest ones, asked only where the map tells
// nothing of a perspective lens.
std::vector<LensDoubt> doubts_of_lenses(const Reconstruction& reconstruction,
                                        std::span<const ViewPtr> keyframes, const TrackingRig& rig,
                                        const ViewMaker& maker, uint64_t seed);

// What there is to say where the poses stay those of a doubtful lens, of a rig of so many cameras.
std::string doubt_warning(const std::vector<LensDoubt>& doubts, size_t cameras);

// What a run with a camera file was made of.
struct GivenCameras {
  Rig rig;  // as given
  bool can_be_read_again = false;
};

// The footage tracked with its own lens, where that is another one than the given and explains it as well or
// better: with the lens that the footage of a perspective camera tells by itself; with the cameras of the
// file at the focal lengths that the maps tell. `tracked`: with the file's. None where there is no such lens;
// what there is to say then is `warning`, empty where what spoke against the file came to nothing.
std::optional<TrackResult> track_with_own_lens(const TrackSettings& settings, const TrackCallbacks& callbacks,
                                               const GivenCameras& given,
                                               const std::vector<LensDoubt>& doubts,
                                               const TrackResult& tracked, std::string* warning);

// The lens that the footage of one camera tells by itself; none where it tells none. `input`: whose first
// stream is the camera's. `is_alone`: it is all of the input, which may be tracked for it.
std::optional<FoundLens> own_lens(const TrackSettings& settings, Input input, bool is_alone,
                                  const TrackCallbacks& callbacks);

// Opens the inputs of the settings, once more. `lens_is_found`: whatever calibration lies beside the images.
Result<Input> open_inputs(const TrackSettings& settings, bool lens_is_found = false);

}  // namespace raysfm
