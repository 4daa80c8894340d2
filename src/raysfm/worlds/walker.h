#pragma once

#include <vector>

#include "raysfm/worlds/surface.h"

namespace raysfm::synth {

// A person who walks to and fro between two places on the ground, for ever.
struct Walker {
  Eigen::Vector3d from, to;  // world, on the ground
  double speed = 1.3;        // metres per second
  double phase = 0;          // metres already walked at time 0
  double height = 1.75;      // metres
  Finish skin, coat, trousers;

  // Where the feet are at `time` (seconds), and the direction of walking (unit).
  Eigen::Vector3d place(double time) const;
  Eigen::Vector3d heading(double time) const;

  // Appends the nine ellipsoids of the body at `time`.
  void pose(double time, std::vector<Ellipsoid>* body) const;
};

}  // namespace raysfm::synth
