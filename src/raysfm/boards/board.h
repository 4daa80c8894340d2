#pragma once

#include <Eigen/Core>
#include <cmath>
#include <string>
#include <vector>

namespace raysfm {

// A chessboard: its inner corners and the side of a square, in the unit that places of cameras shall have.
struct Board {
  int columns = 0, rows = 0;
  double square = 1;

  int corners() const { return columns * rows; }
  // Corners go row by row. The board's frame: origin in its middle, x along the rows, y along the columns.
  Eigen::Vector3d corner(int i) const {
    return square * Eigen::Vector3d(i % columns - 0.5 * (columns - 1), i / columns - 0.5 * (rows - 1), 0);
  }
};

// The corners of the board in an image of one camera, board.corners() of them, row by row.
struct BoardImage {
  int camera = 0;
  std::string name;  // of the image, for messages
  std::vector<Eigen::Vector2d> pixels;
};

// What the cameras of a rig see of the board at one instant: at most one image of each camera.
using BoardView = std::vector<BoardImage>;

// The image of a camera in a view, null where it does not see the board.
inline const BoardImage* image_of(const BoardView& view, int camera) {
  for (const BoardImage& image : view) {
    if (image.camera == camera) return &image;
  }
  return nullptr;
}

// Mean distance of the corners of two images of a board.
inline double mean_distance(const std::vector<Eigen::Vector2d>& a, const std::vector<Eigen::Vector2d>& b) {
  double sum = 0;
  for (size_t i = 0; i < a.size(); ++i) sum += (a[i] - b[i]).norm();
  return a.empty() ? 0 : sum / static_cast<double>(a.size());
}

}  // namespace raysfm
