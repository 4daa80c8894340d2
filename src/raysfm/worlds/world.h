#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/core/thread_pool.h"
#include "raysfm/worlds/materials.h"
#include "raysfm/worlds/surface.h"
#include "raysfm/worlds/walker.h"

namespace raysfm::synth {

// One far lamp and light from everywhere.
struct Light {
  Eigen::Vector3f toward = {-0.45f, -0.80f, -0.40f};  // unit, about
  float ambient = 0.55f;                              // share of light that comes from everywhere
  float on(const Eigen::Vector3f& normal) const {
    return ambient + (1.f - ambient) * std::max(0.f, normal.dot(toward));
  }
};

// Where cameras may go in a world. Control points stand `spacing` metres apart and become a smooth curve, see
// curve.h.
struct Stage {
  double spacing = 1;                // metres
  std::vector<Eigen::Vector3d> way;  // of `drive`, `walk` and `look`, at eye height
  Eigen::Vector3d straight_from, straight_direction = Eigen::Vector3d::UnitZ();  // of `straight`; unit
  double straight_length = 0;                                                    // metres
  std::vector<Eigen::Vector3d> circuit;  // of `loop`, closed: the first point follows the last
  Eigen::Vector3d eye;                   // `handheld` and `rotate` stand here
  double eye_yaw_deg = 0;                // looking this way, about the y axis, 0: along z
  Eigen::Vector3d centre;                // `orbit` looks at it
  double orbit_radius = 1;               // metres
  double orbit_height = 0;               // metres of the camera above `centre`
  double orbit_arc_deg = 360;            // how far around
  double orbit_start_deg = 0;            // the camera begins at centre + radius (sin, 0, -cos) of this angle
};

// How a world is filmed unless the user says otherwise.
struct Habit {
  std::string motion;
  int frames = 0;
  double fps = 0;  // Hz
};

// All that is rendered, and the way that a camera may take through it.
struct World {
  std::string name;
  std::shared_ptr<MaterialLibrary> materials;
  std::vector<Quad> quads;
  std::vector<Ellipsoid> ellipsoids;
  std::vector<Walker> walkers;
  Light light;
  bool open_air = false;  // sky above; else rays that leave the world see black
  Stage stage;
  Habit habit;
  double length = 0;                       // metres of `way`
  std::vector<Eigen::Vector3d> landmarks;  // inner corners of the checkerboards, board by board, row by row
};

// A world as `synth --list` shows it.
struct WorldInfo {
  std::string_view name;
  std::string_view description;
  double usual_length;  // metres of way
};

// The worlds that make_world knows.
const std::vector<WorldInfo>& world_list();

struct WorldOptions {
  double length = 0;  // metres that the way must have, up to 2000; 0: the world's usual length
  uint64_t seed = 0;  // of the arrangement
};

// Metres of way in a world that make_world knows, else 0.
double usual_length(std::string_view name);

// A world is never shorter than usual, so that a shorter drive sees the same things. Error: unknown name, or
// a length that the world cannot have.
Result<World> make_world(std::string_view name, const WorldOptions& options, ThreadPool& pool);

}  // namespace raysfm::synth
