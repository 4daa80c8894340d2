#pragma once

#include <Eigen/Core>
#include <array>
#include <span>

#include "raysfm/geometry/pose.h"
#include "raysfm/geometry/ray.h"
#include "raysfm/solvers/ray_class.h"

namespace raysfm {

// One equation in the 18 entries of the motion.
using PlessRow = Eigen::Matrix<double, 1, 18>;

// Row a of the linear Pless equation a x = 0 of one match (LBA09 4.3, equation 2); x holds R~ and then E~, by
// columns, of the pose rig0_from_rig1.
PlessRow pless_row(const Ray& ray0, const Ray& ray1);

// Orthonormal basis of the solutions that are exact whatever the directions of the rays (LBA09 appendix B),
// as columns: 9, 3 or 1 for simple matches of central, axial or non-axial rays, 9, 1 or 0 others.
Eigen::Matrix<double, 18, Eigen::Dynamic> exact_pless_solutions(const RayClass& ray_class);

// Relative pose of two views of a rig of any rays from 17 or more matches by the linear Pless equation
// (LBA09 4.3). `ray_class` is that of all the rays in use, whose centres may not all be in the sample. The
// paper takes the true solution out of the kernel by a non-linear search for the R~ that is a rotation. Here
// the origin is moved to the centre of the rays first, where the exact solutions have no E~ (appendix B), so
// that E~ is read off the part of the kernel orthogonal to them. Its decompositions get the scale that fits
// the matches best, in closed form. Writes rig1_from_rig0, best fit first, and returns how many, 0 to 4. For
// a central rig, the centre moves by 1.
int seventeen_point(std::span<const Ray> rays0, std::span<const Ray> rays1, const RayClass& ray_class,
                    std::array<Rigid3, 4>* rig1_from_rig0);

}  // namespace raysfm
