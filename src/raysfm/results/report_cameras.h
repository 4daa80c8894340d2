#pragma once

#include <nlohmann/json_fwd.hpp>

#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// What report.json says of cameras, with all digits, and its way back.

// Writes `rig`: name, model, resolution and place of each of its cameras.
void write_rig_json(const Rig& rig, nlohmann::ordered_json* report);

// Name and place of cameras that are there already, as many as `rig` has. Throws nlohmann::json::exception
// where the report does not tell.
void read_rig_json(const nlohmann::ordered_json& report, Rig* rig);

// Writes `distortion` and `lenses`: the numbers and standard deviations of each, null where infinite, and
// runs of frames [first, last], of which those with a pose have it.
void write_lenses_json(const Reconstruction& reconstruction, nlohmann::ordered_json* report);

// The lenses, and which of them the frames have, which are there already with their poses. Throws as above.
void read_lenses_json(const nlohmann::ordered_json& report, Reconstruction* reconstruction);

}  // namespace raysfm
