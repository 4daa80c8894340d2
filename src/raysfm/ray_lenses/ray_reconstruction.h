#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include "raysfm/calibration/rig_parameters.h"
#include "raysfm/camera/camera.h"
#include "raysfm/geometry/pose.h"
#include "raysfm/lenses/point_tracks.h"

namespace raysfm {

struct RayReconstruction;

// How tracks are reconstructed through a camera that is guessed, or known.
struct RayOptions {
  double max_error_px = 3.0;  // of an inlier, > 0
  // Standard deviation of the principal point about the one guessed, as a share of the image's longer side, >
  // 0.
  double centre_sigma = 0.03;
  bool is_known = false;  // the camera is no guess: it stays as it is
  bool in_order = true;   // of time; else images see one another in any order
  // A reconstruction of a part of the images to go on from, of photos; null: there is none.
  const RayReconstruction* start = nullptr;
  uint64_t seed = 0;
  int threads = 1;                          // > 0; never changes a result
  std::function<bool()> stopped = nullptr;  // asked now and then; true: ends early with what there is
  std::function<void(int posed)> progress = nullptr;  // told now and then: how many images have a pose
};

// Structure and motion of tracks, and the camera that all images were taken with.
struct RayReconstruction {
  Camera camera;
  CalibrationPrior sigma;  // how sure its numbers are: standard deviations, infinite where nothing tells them
  // The coefficient of its model that moves the rim of the image most, all others being as guessed: by how
  // many tenths of its distance from the centre.
  double strain = 0;
  std::vector<Rigid3> cam_from_world;   // one per image
  std::vector<Eigen::Vector3d> points;  // world; one per point
  std::vector<uint8_t> image_posed;     // one per image
  std::vector<uint8_t> point_placed;    // one per point
  std::vector<uint8_t> inlier;          // one per observation
  int posed = 0;                        // images; 0: no three of them start a reconstruction
  std::array<int, 3> start_images = {-1, -1, -1};
  int start_inliers = 0;  // points that the three see
};

// Reconstructs the tracks of a video, images in the order of time, or of photos, as seen along the rays of a
// central camera that projects, and where it is guessed adjusts the numbers of its model as more is seen:
// three images are the start, the others follow by the points that they share, and in between poses and
// points, then the camera by what the residuals say of it. The guess may be wrong by half or twice the focal
// length: lenses that bend rays much are told by few images.
RayReconstruction reconstruct_along_rays(const PointTracks& tracks, const Camera& guess,
                                         const RayOptions& options);

// Of the observations in posed images, of points that two of them see: the share that agrees with the
// reconstruction; 0 without any.
double agreeing_share(const PointTracks& tracks, const RayReconstruction& r);

// Difference of an observation's pixel to where the reconstruction sees its point; false where it sees none,
// or image or point have no place.
bool pixel_residual(const PointTracks& tracks, const RayReconstruction& r, int observation,
                    Eigen::Vector2d* residual);

}  // namespace raysfm
