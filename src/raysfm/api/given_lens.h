#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raysfm/api/track.h"
#include "raysfm/camera/camera.h"
#include "raysfm/scene/reconstruction.h"
#include "raysfm/views/tracking_rig.h"
#include "raysfm/views/view_maker.h"

namespace raysfm {

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

}  // namespace raysfm
