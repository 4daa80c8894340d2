#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/geometry/trajectory.h"

namespace raysfm {

// Reads a trajectory; the content decides the format:
//  - TUM: `timestamp tx ty tz qx qy qz qw`, world from camera, seconds, Hamilton quaternion. Empty lines and
//    lines that begin with # are skipped. A quaternion whose length is within 1e-3 of one is normalised,
//    others are refused;
//  - KITTI: the 12 numbers of a 3 x 4 matrix [R t] by rows, world from camera. R is replaced by the nearest
//    rotation if its entries are within 1e-3 of it, else refused. Timestamps are the lines of `times.txt` in
//    the same folder, or the index of the line where there is no such file;
//  - EuRoC's truth (lines with commas): `timestamp,x,y,z,qw,qx,qy,qz` in nanoseconds, world from *body*, with
//    more columns behind, which are passed over.
// `path` may also be a folder: then the first of trajectory.txt, truth.txt, poses.txt, groundtruth.txt and
// [mav0/]state_groundtruth_estimate0/data.csv in it. Timestamps strictly increase. An error names file, line,
// value and what is allowed.
Result<Trajectory> read_trajectory(const std::filesystem::path& path);

// The trajectories of the worlds that one run found, the main one first: `path`, or the trajectory in it
// where it is a folder, and the files of that name in worlds/1, worlds/2, ... beside it.
Result<std::vector<std::filesystem::path>> trajectories_of_worlds(const std::filesystem::path& path);

// Writes TUM format, with as many digits as read_trajectory() needs to read the same numbers. `header` is put
// before the poses as comment lines, each beginning with "# ".
Result<void> write_trajectory(const Trajectory& trajectory, const std::string& header,
                              const std::filesystem::path& path);

}  // namespace raysfm
