#pragma once

#include <string>

#include "raysfm/page/page_info.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// Two texts of JSON without line breaks or any character that ends a script; viewer/src/data.js reads them.
// `first` is enough for a picture, with no more than 30000 points in all; `rest` has the others, `xyz` and
// `rgb` of each world, which follow those.
struct PageData {
  std::string first, rest;
};

// What the page shows. Arrays of numbers are little endian in base64. World by world, the main one first:
//  - frames with a pose: `index` (u32), `time` (f64, seconds), `pose` (f32: position, quaternion x y z w;
//  world from
//    rig), `covariance` (f32: xx xy xz yy yz zz of the position), `turn` (f32: standard deviation of the
//    rotation, degrees, the root of the mean of three axes), `lens` (i32: index into `lenses`, -1 none)
//  - key frames: `frame` (u32, index into the frames above), `seen` (u32, observations), `error` (f32, rms of
//    reprojection in pixels, NaN where there is none)
//  - points: `xyz` (u16, from 0 to 65535 between `low` and `high`), `rgb` (u8), `count`, `all` (before
//    thinning), `far` (left out). Any beginning of them is spread evenly over the map
//  - cameras of the rig, or lenses: their position and the directions of the image's border, in the rig; of
//    a rig, and of a lens that is the only one, also `rays` (f32: origin and direction of the pixels of a
//    grid of `grid` columns and rows, NaN where a pixel sees nothing)
//  - where there is one, the surface of a world: `positions` (f32), `faces` (u32: three vertices), `places`
//  (u16: of
//    each corner, in parts of the texture from its lower left), `texture` (a JPEG file)
// and beside them runs of frames without a pose with the reason, closures, times of stages, and of a run
// under way the newest frame that has a pose.
PageData page_data(const Reconstruction& reconstruction, const PageInfo& info);

}  // namespace raysfm
