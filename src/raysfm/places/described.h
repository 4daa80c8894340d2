#pragma once

#include <vector>

#include "raysfm/features/descriptor.h"
#include "raysfm/scene/map.h"
#include "raysfm/views/view.h"

namespace raysfm {

constexpr int kDescribedPoints = 600;  // of a key frame, for one camera

// Describes what a key frame is recognised by: its features whose tracks have a position, up to
// kDescribedPoints for each camera, spread over the image. `view` holds its images.
void describe_keyframe(const Map& map, const View& view, Describer& describer, MapKeyFrame* keyframe);

// The corners of a view with what they look like.
struct DescribedCorners {
  std::vector<TrackPixel> corners;  // their tracks are not known
  std::vector<Descriptor> descriptors;
  std::vector<UprightDescriptor> upright = {};  // of the same corners; empty until asked for
};
DescribedCorners describe_corners(const View& view, Describer& describer);
void describe_upright(const View& view, Describer& describer, DescribedCorners* corners);

}  // namespace raysfm
