#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "raysfm/lenses/point_tracks.h"
#include "raysfm/lenses/uncalibrated_scene.h"

namespace raysfm {

// The usable observations of point tracks in two orders: by image (then point), in which they are visited,
// and by point (then image), in which the points are eliminated: their *slots*. Images and points are
// renumbered without gaps.
struct ObservationIndex {
  std::vector<int> images;  // original numbers, ascending
  std::vector<int> points;

  std::vector<int> image_begin;        // observations of image j: [image_begin[j], image_begin[j + 1])
  std::vector<int> point_of;           // of an observation
  std::vector<int> slot_of;            // of an observation
  std::vector<int> original;           // of an observation: its number in the tracks
  std::vector<Eigen::Vector2d> pixel;  // of an observation
  std::vector<double> weight;          // of an observation, > 0

  std::vector<int> point_begin;    // slots of point i: [point_begin[i], point_begin[i + 1])
  std::vector<int> image_of_slot;  // ascending in a point

  int image_count() const { return static_cast<int>(images.size()); }
  int point_count() const { return static_cast<int>(points.size()); }
  int size() const { return static_cast<int>(point_of.size()); }
};

// Leaves out observations of weight 0 or behind their camera, images with fewer than `min_points` and points
// in fewer than `min_images` of the rest. `weights` is empty (all 1) or one for each observation; `scene` may
// be null (no camera, nothing is behind it). The tracks are valid.
ObservationIndex index_observations(const PointTracks& tracks, std::span<const double> weights,
                                    const UncalibratedScene* scene, int min_points, int min_images);

}  // namespace raysfm
