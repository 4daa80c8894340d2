#pragma once

#include <memory>
#include <string>
#include <vector>

#include "raysfm/camera/camera.h"
#include "raysfm/features/coarse_rotation.h"
#include "raysfm/features/feature_grid.h"
#include "raysfm/features/features.h"
#include "raysfm/features/harris.h"
#include "raysfm/features/patches.h"
#include "raysfm/image/image.h"
#include "raysfm/odometry/tracking_rig.h"
#include "raysfm/scene/map.h"

namespace raysfm {

// The image of one camera after detection: everything that later stages need of it.
struct CameraView {
  GrayImage image;
  Image<uint8_t> bgr;  // empty where the input is grey
  Features features;
  PatchSet patches;  // of the features
  FeatureGrid grid;  // of the features
  GrayImage thumbnail;
  int thumbnail_scale = 1;  // pixels of the image per pixel of the thumbnail
};

// One frame: an image of every camera of the rig, taken at one instant. Made ahead of time on any thread.
struct View {
  int frame = 0;
  double timestamp = 0;  // seconds
  std::string name;
  std::vector<CameraView> cameras;
  double detect_ms = 0;
};

using ViewPtr = std::shared_ptr<const View>;

// Motion of the image as a whole between two views, told by their thumbnails.
CoarseMotion coarse_motion(const CameraView& first, const CameraView& second);

// Fills features, patches, grid and thumbnail from the image. `detector` holds scratch memory; one per
// thread.
void detect(HarrisDetector& detector, const HarrisOptions& options, CameraView* view);

// Patch i of one set becomes patch j of another.
void copy_patch(const PatchSet& from, int i, int j, PatchSet* to);

// Colour of the pixel nearest to a place inside the image; a grey of the same brightness where the input is
// grey.
std::array<uint8_t, 3> color_at(const CameraView& view, const Eigen::Vector2f& pixel);

// What matching needs of a key frame, beside its geometry in the map. The vectors run over the features of
// the map's key frame.
struct KeyFrameView {
  ViewPtr view;
  std::vector<int> cameras;
  std::vector<Eigen::Vector2f> pixels;
  PatchSet patches;
  std::vector<Eigen::Vector3f> origins, directions;       // of the rays, in their camera's frame
  std::vector<Eigen::Matrix<float, 3, 2>> ray_jacobians;  // d direction / d pixel; zero where there is none

  const CameraView& camera_view(int feature) const { return view->cameras[cameras[feature]]; }
};

// Views and rays of a key frame's features, in the map's order.
KeyFrameView make_keyframe_view(ViewPtr view, const MapKeyFrame& keyframe, const TrackingRig& rig);

}  // namespace raysfm
