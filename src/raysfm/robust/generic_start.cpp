#include "raysfm/robust/generic_start.h"

namespace raysfm {

GenericStart start_generic(const RigMatches& matches, const GenericStartOptions&) {
  GenericStart start;
  start.points_in_rig0.assign(matches.point_count, Eigen::Vector3d::Zero());
  start.inlier.assign(matches.point_count, 0);
  return start;
}

std::string describe(const GenericStart&) {
  return "too few matches over three views";
}

}  // namespace raysfm
