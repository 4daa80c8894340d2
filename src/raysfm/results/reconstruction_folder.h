#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// What write_output_folder() wrote for `track`, `solve` or `adjust`, every world a segment again; written
// anew, it gives the same files. Timestamps, poses, covariances, lenses with their standard deviations and
// the points that key frames see come back bit by bit; other points as floats, pixels but for the rounding of
// half a pixel. The name of an image comes back for key frames and for frames without a pose. Observations
// and the models of a rig's cameras come from sparse/; where COLMAP has no such camera observations come from
// observations.csv, bit by bit, and there are no models. Of `adjust`, the adjusted model is read.
//
// Errors: bad input, naming the file.
Result<Reconstruction> read_reconstruction(const std::filesystem::path& folder);

// What a finished result was made of, as it was given then; none where report.json in the folder does not
// tell.
std::vector<std::string> inputs_of_result(const std::filesystem::path& folder);

}  // namespace raysfm
