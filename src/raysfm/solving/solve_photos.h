#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "raysfm/frames/frame_source.h"
#include "raysfm/solving/solve_input.h"

namespace raysfm {

// Most photos, and most images that are looked at for whether they are photos.
inline constexpr int kMaxPhotos = 500, kMaxAutoPhotos = 100;

// Images that are compared in this way when they do not go well as a video.
inline constexpr int kFewImages = 40;

// Tracks of a video, or of photos where `settings.images` or the images say so: where they differ in size, or
// where too few corners of an image agree with the one before. Says which was chosen and why. Errors: bad
// input.
Result<SolveInput> tracks_from_images(const SolveSettings& settings, const SolveCallbacks& callbacks);

// The camera of settings.camera, fit for the images of `opened`, or of any size where that is null. Errors:
// bad input, also of what is no single camera with one viewpoint that sees all of an image: of that, only
// videos are understood.
Result<Camera> known_camera(const SolveSettings& settings, const Input* opened, const EventSink& event);

// Tracks of photos that may be taken from anywhere: clear matches of pairs that agree with a fundamental
// matrix, of all pairs or, of many photos, of those that look alike; of a known camera with an essential
// matrix, along its rays. Errors: bad input.
Result<SolveInput> tracks_from_photos(const SolveSettings& settings, const SolveCallbacks& callbacks);

// Where a reconstruction of photos leaves some out (`posed`: one per photo, or 0 of all where there is none):
// the tracks of `input`, joined with what those photos share with all others by matches that are less clear.
// None of a video, or where none is left out.
std::optional<SolveInput> with_loose_matches(const SolveInput& input, std::span<const uint8_t> posed,
                                             const SolveSettings& settings, const SolveCallbacks& callbacks);

}  // namespace raysfm
