#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <span>
#include <string>

#include "raysfm/core/result.h"
#include "raysfm/uncalibrated/reconstruct.h"

namespace raysfm {

// What reconstruct_video() takes beside what is common to all images.
struct VideoOptions {
  // False: photos, of which one sees what any other may see. They start from a group that sees much of one
  // another in the place of a stretch.
  bool in_order = true;
  // A reconstruction of a part of the images to go on from; null: there is none.
  const UncalibratedReconstruction* start = nullptr;
  // Key frames with a pose, of all; one call at a time, from any thread.
  std::function<void(int posed, int keyframes)> progress = nullptr;
  const std::atomic<bool>* stop = nullptr;  // set: ends early with what there is
};

// As reconstruct(), for images in the order of time of which only some are key frames: a stretch of key
// frames is the start, the others are added one after the other, outward from it, with an adjustment in
// between; last, every other image is posed by the points that it sees, with its own focal length where the
// lens zooms. `keyframe`: one per image. `start_images` of the result are images of `tracks`.
// Errors: as reconstruct().
Result<UncalibratedReconstruction> reconstruct_video(const PointTracks& tracks,
                                                     std::span<const uint8_t> keyframe,
                                                     const SolveOptions& options,
                                                     const VideoOptions& video = {});

// What speaks for a zoom where one lens was found for all images.
struct ZoomSigns {
  bool zooms = false;
  std::string evidence;         // as UncalibratedReconstruction::lens_evidence
  double gain = 0, spread = 0;  // as lens_gain and lens_spread of UncalibratedReconstruction
};

// Whether a lens for each image explains the tracks of the images that take part (1 in `keyframe`) so much
// better than the one lens in `fixed` that the camera seems to zoom: from there, each image gets a lens of
// its own in one short adjustment, and choose_lens() compares the two. That takes a twentieth of the time of
// finding `fixed`, and leaves the lenses short of what they are in the end: of a zoom by 1.2 it may see
// nothing, above all where the camera goes the way it looks.
ZoomSigns signs_of_zoom(const PointTracks& tracks, std::span<const uint8_t> keyframe,
                        const SolveOptions& options, ErrorRelation errors,
                        const UncalibratedReconstruction& fixed);

}  // namespace raysfm
