#pragma once

#include <Eigen/Core>

#include "raysfm/mesh/tetrahedra.h"

namespace raysfm {

// Goes along a segment from tetrahedron to tetrahedron.
class SightWalk {
 public:
  // From `from`, which lies in `cell`, to `to`; `tetrahedra` must outlive it and not change.
  SightWalk(const Tetrahedra& tetrahedra, int cell, const Eigen::Vector3d& from, const Eigen::Vector3d& to);

  // Goes on into the next tetrahedron. False at the end, or where the box ends.
  bool next();

  int cell() const { return cell_; }
  // The tetrahedron left last, and by which of its faces.
  int left_cell() const { return left_cell_; }
  int left_face() const { return left_face_; }
  // Where on the segment that was: 0 at its beginning, 1 at its end.
  double at() const { return at_; }

 private:
  const Tetrahedra& tetrahedra_;
  Eigen::Vector3d from_, direction_;
  int cell_, left_cell_ = -1, left_face_ = -1, steps_ = 0;
  double at_ = 0;
};

}  // namespace raysfm
