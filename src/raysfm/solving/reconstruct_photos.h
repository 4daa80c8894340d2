#pragma once

#include <vector>

#include "raysfm/ray_lenses/ray_reconstruction.h"
#include "raysfm/solving/solve_input.h"
#include "raysfm/uncalibrated/reconstruct.h"

namespace raysfm {

// Structure, motion and lenses of photos (tracks_from_photos()), by what is clear of their matches first:
// along the rays of one lens that is guessed, from where a lens for each photo is tried; without a guess
// where photos zoom, or more than a fifth stay out, and then the better of the two. Photos that stay out are
// compared less strictly, to go on from what there is, and from the start where more than a fifth are out.
// `input` becomes what the reconstruction is of. Errors: as reconstruct_input().
Result<UncalibratedReconstruction> reconstruct_photos(SolveInput* input, const SolveSettings& settings,
                                                      const SolveCallbacks& callbacks);

// Structure and motion of photos, or tracks in a file, of the camera that is given, input->camera; photos are
// compared less strictly in the same way where any stays out. The main world, and those of images that it
// leaves out (worlds_left_out()); empty: no three images start a reconstruction.
std::vector<RayReconstruction> reconstruct_worlds_of_camera(SolveInput* input, const SolveSettings& settings,
                                                            const SolveCallbacks& callbacks);

}  // namespace raysfm
