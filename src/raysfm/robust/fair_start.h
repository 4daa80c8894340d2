#pragma once

#include <span>

#include "raysfm/robust/generic_start.h"

namespace raysfm {

// A start that whatever moves has no more say in than its part of the image.
struct FairStart {
  GenericStart start;      // its points are those given
  double rival_share = 0;  // of the image, by its matches: what another motion explains; 0 where nobody asked
};

// As start_generic(). Where many matches disagree with what it finds, a second motion is looked for among
// these: of the two that one is the rig's which explains more of the image, and the matches of the other are
// left out. Where neither does, and where the second is no start, the problem is kTwoMotions. People, cars
// and screens have more corners than walls, and are followed for longer. `places`: of each point, the part of
// the image in which view 0 sees it; equal numbers are one part, and all parts count alike.
FairStart start_fairly(const RigMatches& matches, std::span<const int> places,
                       const GenericStartOptions& options);

}  // namespace raysfm
