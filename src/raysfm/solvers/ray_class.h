#pragma once

#include <Eigen/Core>
#include <span>

#include "raysfm/geometry/ray.h"

namespace raysfm {

// Where the origins of the rays in use lie (LBA09 4.3), which decides what the Pless equation can tell.
enum class CentreClass {
  kCentral,   // all at one point
  kAxial,     // on one line
  kNonAxial,  // not on one line
};

// What kind of rays matches have.
struct RayClass {
  CentreClass centres = CentreClass::kCentral;
  // Both rays of every match have the same origin ("simple" matches, LBA09 4.2).
  bool simple = true;
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  // mean of the origins
  Eigen::Vector3d axis = Eigen::Vector3d::UnitX();   // unit direction of their largest spread
  double spread = 0;                                 // root mean square distance from the centre

  // Dimension of the kernel of the linear Pless equations of many matches: 10, 4, 2 for simple matches of
  // central, axial and non-axial rays, else 10, 2, 1 (LBA09 table 2 and appendix B).
  int kernel_dimension() const {
    if (centres == CentreClass::kCentral) return 10;
    if (centres == CentreClass::kAxial) return simple ? 4 : 2;
    return simple ? 2 : 1;
  }
};

// Class of the rays of matches i between two views, in the rig's frame of each; spans of one length. Origins
// that differ by less than `tolerance` times the largest distance from the centre count as one; all of
// them do when none is farther than `same` units of length from the centre.
RayClass classify_rays(std::span<const Ray> rays0, std::span<const Ray> rays1, double tolerance = 1e-6,
                       double same = 1e-12);

// Name as in reports: "central", "axial" or "non-axial".
const char* name_of(CentreClass centres);

}  // namespace raysfm
