#pragma once

#include <array>
#include <cstdint>

namespace raysfm {

// A point of a grid of integers; coordinates in [0, kGridSide).
using GridPoint = std::array<int32_t, 3>;

// What keeps the determinants below within 128 bits.
inline constexpr int32_t kGridSide = 1 << 23;

// Sign of the volume of the tetrahedron a b c d: positive where a, b, c turn clockwise as seen from d. Exact.
int orientation(const GridPoint& a, const GridPoint& b, const GridPoint& c, const GridPoint& d);

// Positive where e lies inside the sphere through a, b, c and d, whose orientation is positive; 0 on it.
// Exact.
int in_sphere(const GridPoint& a, const GridPoint& b, const GridPoint& c, const GridPoint& d,
              const GridPoint& e);

}  // namespace raysfm
