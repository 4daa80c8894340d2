#pragma once

#include <Eigen/Core>
#include <array>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "raysfm/core/result.h"

namespace raysfm {

// Point seen by a camera. The pixel is counted from the centre of the image, x to the right and y up.
struct BalObservation {
  int camera = 0;
  int point = 0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
};

// A problem of Bundle Adjustment in the Large (Agarwal, Snavely, Seitz and Szeliski, ECCV 2010). A camera is
// a rotation vector, a translation (both camera from world, looking along -z), f, k1 and k2:
//   P = R X + t,  p = -(P.x, P.y) / P.z,  pixel = f (1 + k1 |p|^2 + k2 |p|^4) p
struct BalFile {
  std::vector<std::array<double, 9>> cameras;
  std::vector<Eigen::Vector3d> points;
  std::vector<BalObservation> observations;  // in the order of the file
  bool compressed = false;                   // by bzip2
};

// Allowed in a file; wider than anything that was ever photographed, and narrow enough that no square of a
// residual overflows.
constexpr double kMaxBalPixel = 1e6;        // |x| and |y| of an observation
constexpr double kMaxBalAngle = 1e4;        // radians, each of the rotation vector
constexpr double kMaxBalCoordinate = 1e12;  // of a translation or a point
constexpr double kMaxBalFocal = 1e7;        // pixels; f is above 0
constexpr double kMaxBalDistortion = 1e12;  // |k1| and |k2|

// From text: `cameras points observations`, then `camera point x y` for each observation, then 9 numbers for
// each camera and 3 for each point, between any white space. Indices from 0, numbers in the ranges above.
// Memory is taken only after the counts were found to fit into the text. Errors: bad input, naming `name`,
// line, field, value and what is allowed.
Result<BalFile> parse_bal(std::string_view text, const std::string& name);

// The same text with 17 digits, which parse_bal() reads back to the same bits.
std::string format_bal(const BalFile& file);

// A file of such text, plain or packed by bzip2 (the content decides), at most 8 GiB of text.
Result<BalFile> read_bal_file(const std::filesystem::path& path);

// Writes plain text, or packed by bzip2 if file.compressed.
Result<void> write_bal_file(const BalFile& file, const std::filesystem::path& path);

}  // namespace raysfm
