#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "raysfm/camera/camera.h"
#include "raysfm/lenses/point_tracks.h"
#include "raysfm/photos/photo_points.h"
#include "raysfm/photos/track_bridges.h"
#include "raysfm/results/report_file.h"
#include "raysfm/solving/solve_settings.h"

namespace raysfm {

// Point tracks over all frames of an input.
struct SolveInput {
  PointTracks tracks;                       // image: index into the vectors below
  std::optional<Camera> camera;             // that took all images, where it is given
  std::vector<double> timestamps;           // strictly increasing
  std::vector<std::string> names;           // of the images
  std::vector<std::string> defects;         // why an image shows nothing, else ""; empty: none has one
  std::vector<int> same_as;                 // an image that shows the same and is seen in its place, else -1;
                                            // empty: all show something else
  PhotoPoints photo_points;                 // of photos; without features of a video
  std::vector<ExifLens> exif;               // the lenses that photos name
  std::vector<int> lens_of_image;           // as that of SolveOptions
  bool in_order = true;                     // an image sees what the one before sees
  std::vector<Eigen::Vector2i> sizes;       // of the images where they differ, else empty: see shift()
  double corner_side = 1;                   // pixels that one is of the octave where corners are found
  std::vector<uint8_t> keyframe;            // 1: takes part in the start and the adjustment
  std::vector<DescribedImage> described;    // key frames of a video, in the order of time
  std::vector<std::array<uint8_t, 3>> rgb;  // of the points; empty: unknown
  std::vector<Eigen::Vector3d> structure;   // known positions of the points; empty: unknown
  std::vector<std::pair<std::string, StageTiming>> stages;  // of reading, where they are told apart
  bool interrupted = false;                                 // ends where the caller asked to stop

  // The image, or the one that stands for it.
  int original(int image) const { return same_as.empty() || same_as[image] < 0 ? image : same_as[image]; }

  // Images of different sizes are centred in one as large as the largest: what its pixels are ahead of those
  // of the image.
  Eigen::Vector2d shift(int image) const {
    if (sizes.empty()) return Eigen::Vector2d::Zero();
    return 0.5 * (tracks.image_size - sizes[image].cast<double>());
  }
};

// Says so of images that all show the same one picture or two; empty of others.
std::string no_motion(const SolveInput& input);

// By image: how many of its points the image before it sees; 0 for the first.
std::vector<int> shared_with_previous(const PointTracks& tracks);

// A file of tracks; every image is a key frame. Errors: bad input.
Result<SolveInput> tracks_from_file(const SolveSettings& settings, const SolveCallbacks& callbacks);

}  // namespace raysfm
