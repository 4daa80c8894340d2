#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

namespace raysfm {

// A rectangle that looks for its place; texels.
struct AtlasPatch {
  int width = 0, height = 0;
  int x = 0, y = 0;  // of its corner, once placed
};

// Places patches beside and below each other, none over another, in a rectangle `width` wide; its height.
// Every patch must fit into the width.
int place_patches(int width, std::vector<AtlasPatch>* patches);

}  // namespace raysfm
