#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/core/timer.h"
#include "raysfm/lenses/lens_adjustment.h"
#include "raysfm/lenses/point_tracks.h"
#include "raysfm/lenses/radial_distortion.h"

namespace raysfm {

// Whether all images have one lens; kAuto: the images decide.
enum class LensChange { kAuto, kFixed, kZoom };
// By moments (IFBA01 section 3), with lenses as unknowns, or the first ended by the second.
enum class LensMethod { kIntrinsicsFree, kStandard, kPolished };

// How the errors of observations are related.
enum class ErrorRelation {
  kNone,          // known points, tracks of others: every observation has its own
  kAlongTracks,   // corners followed through a video: alike along a track
  kWithinImages,  // photos: what the lens has beyond a focal length moves all points of an image
};

// Radial distortion of photos with one lens, and of a video.
enum class RadialChoice {
  kNone,   // lenses map straight lines to straight lines
  kFree,   // k1 and k2 of one lens are estimated at the end, k1 alone, for all images, where a video zooms
  kIfSure  // the same, each kept where the images leave no doubt about it
};

// How a scene of unknown lenses is reconstructed.
struct SolveOptions {
  LensChange lens = LensChange::kAuto;
  LensMethod method = LensMethod::kPolished;
  ConstraintMethod constraints = ConstraintMethod::kWeights;
  ErrorRelation errors = ErrorRelation::kNone;
  RadialChoice radial = RadialChoice::kIfSure;
  double max_error_px = 3.0;  // of an inlier, > 0
  // Standard deviation of the principal point about the centre of the image, as a share of the image's
  // larger side; 0: nothing is known of it.
  double principal_point_sigma = 0.03;
  // What is said of the focal length of one lens of photos, pixels, and the standard deviation of that; 0:
  // nothing is.
  double focal = 0, focal_sigma = 0;
  // Of photos: numbers of the lenses that images are said to be taken with, one for each image; those of one
  // number have the same lens. Empty: nothing is said.
  std::vector<int> lens_of_image = {};
  int max_samples = 2000;  // of each RANSAC, > 0
  uint64_t seed = 0;
  int threads = 1;  // > 0; never changes a result
  // Asked in every long loop, from any thread; false: end with what there is, or with none. Empty: to the
  // end.
  ProgressCallback go_on = {};

  bool stopped() const { return go_on && !go_on({}); }
};

// Structure, motion and lenses of tracks, and how sure they are.
struct UncalibratedReconstruction {
  UncalibratedScene scene;
  std::vector<uint8_t> image_posed;    // one per image: pose and lens are valid
  std::vector<uint8_t> point_placed;   // one per point
  std::vector<uint8_t> inlier;         // one per observation
  std::vector<LensVector> lens_sigma;  // one per image, infinite where unknown
  RadialDistortion radial;             // of all images; none unless it was asked for
  RadialDistortion radial_sigma;       // standard deviations
  bool world_is_given = false;         // the world is that of known points, its scale theirs
  bool zooming = false;
  double lens_gain = 0;       // rms with one lens to that with one for each image; 0: these were not compared
  double lens_spread = 0;     // standard deviation of the logarithm of the focal length then
  std::string lens_evidence;  // why the lens was taken for fixed or zooming, one line
  std::string degenerate;     // empty, or the name of the degenerate motion or structure
  double rms_px = 0;          // over the inliers
  int start_images[2] = {-1, -1};  // the two views of the start
  int start_inliers = 0;           // their matches that agree with its fundamental matrix
  LensAdjustmentSummary adjustment;
  std::map<std::string, StageTiming> stages;  // where they are told apart

  int posed_count() const { return static_cast<int>(std::ranges::count(image_posed, 1)); }
  // Part of the images that have a pose; 0 where there are none.
  double posed_share() const {
    return image_posed.empty() ? 0 : posed_count() / static_cast<double>(image_posed.size());
  }
  // The image whose lens stands for all where they share one; -1: none has a pose.
  int first_posed() const {
    const auto image = std::ranges::find(image_posed, 1);
    return image == image_posed.end() ? -1 : static_cast<int>(image - image_posed.begin());
  }
};

// What the options say of the lenses; `equal`: one lens for all images. `noise_px`: standard deviation of an
// observation, for which a third of the largest error allowed is a fair guess.
LensConstraints constraints_for(const PointTracks& tracks, const SolveOptions& options, bool equal,
                                double noise_px);
inline LensConstraints constraints_for(const PointTracks& tracks, const SolveOptions& options, bool equal) {
  return constraints_for(tracks, options, equal, options.max_error_px / 3);
}

// The start alone (IFBA01 4.2): every image and point must be reached. For comparing what follows it.
Result<UncalibratedScene> linear_start(const PointTracks& tracks, const SolveOptions& options,
                                       bool equal_lenses);

// Structure, motion and lenses from point tracks alone (IFBA01 4.2 and 4). kBadInput for tracks that
// contradict themselves; kNoReconstruction when they do not determine a structure, with the reason.
Result<UncalibratedReconstruction> reconstruct(const PointTracks& tracks, const SolveOptions& options);

}  // namespace raysfm
