#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "raysfm/camera/camera.h"
#include "raysfm/features/coarse_rotation.h"
#include "raysfm/features/feature_grid.h"
#include "raysfm/features/features.h"
#include "raysfm/features/harris.h"
#include "raysfm/features/octaves.h"
#include "raysfm/features/patches.h"
#include "raysfm/image/color_planes.h"
#include "raysfm/image/image.h"
#include "raysfm/scene/map.h"
#include "raysfm/views/tracking_rig.h"

namespace raysfm {

constexpr int kOctavesWithFeatures = 2;  // from the first on, of each picture

// What the first step, look(), makes of the image of one camera: all that a view needs that is only posed.
// Copies share the pictures.
struct CameraImage {
  int width = 0, height = 0;
  std::shared_ptr<const Octaves> octaves;
  std::shared_ptr<const GrayImage> thumbnail;
  int thumbnail_scale = 1;  // pixels of the image per pixel of the thumbnail
  // Of the picture in which this image begins at `origin`; let go by detect(). Null where it is grey.
  std::shared_ptr<const ColorPlanes> colors;
  Eigen::Vector2i origin = Eigen::Vector2i::Zero();

  int longer_side() const { return std::max(width, height); }
};

// The image of one camera: everything that later stages need of it. Pixels are those of the image as taken,
// whatever the octave (features/octaves.h) that something was found in.
struct CameraView : CameraImage {
  GrayImage image;  // until look(), which moves it into the octaves

  // By detect():
  Features features;
  PatchSet patches;                         // of the features, in their octaves
  std::vector<FeatureGrid> grids;           // of the features of octaves->first(), and of those that follow
  std::vector<std::array<uint8_t, 3>> rgb;  // of the features; greys where the input is grey

  bool detected() const { return !grids.empty(); }
  // The octaves with features.
  int first_octave() const { return octaves->first(); }
  int last_octave() const { return octaves->clamp(octaves->first() + kOctavesWithFeatures - 1); }
  int clamp_octave(int octave) const { return std::clamp(octave, first_octave(), last_octave()); }
  const FeatureGrid& grid(int octave) const { return grids[octave - octaves->first()]; }
};

// Which frame a view is of: all of it but what its images show. Whatever is made of a view has the same.
struct ViewStamp {
  int frame = 0;
  double timestamp = 0;  // seconds
  std::string name;
  std::string defect;    // why an image cannot be used; empty: none. There are no cameras then
  int same_as = -1;      // frame whose pictures it shows once more; it has no cameras then. -1: none
  int repeats = 0;       // frames before it that show others once more
  double detect_ms = 0;  // that both steps took ahead of time

  // Of random numbers: those of a film are the same with and without frames that repeat others.
  uint64_t random_stream() const { return static_cast<uint64_t>(frame - repeats); }
};

// One frame: an image of every camera of the rig, taken at one instant. Made ahead of time on any thread.
struct View : ViewStamp {
  View() = default;
  // A view of the same frame, without cameras.
  explicit View(const ViewStamp& stamp) : ViewStamp(stamp) {}
  const ViewStamp& stamp() const { return *this; }

  std::vector<CameraView> cameras;
  bool evenly = false;  // its corners are those of ViewMaker::detected_evenly()

  bool detected() const { return std::ranges::all_of(cameras, &CameraView::detected); }
};

// Views are not changed once others may see them.
using ViewPtr = std::shared_ptr<const View>;

// Motion of the image as a whole between two views, told by their thumbnails.
CoarseMotion coarse_motion(const CameraView& first, const CameraView& second);

// The first step, from the image: octaves and thumbnail.
void look(CameraView* view);

// The second step, with the first where that is still to do: corners with their patches and colours.
// `detector` holds scratch memory; one per thread.
void detect(HarrisDetector& detector, const HarrisOptions& options, CameraView* view);

// The images of a view without what detection found in them: what remains of it in a key frame.
ViewPtr images_of(const View& view);
// The same without their finest octaves (Octaves::without_finest).
ViewPtr coarser_images_of(const View& view, int octaves);
// What images and patches take.
size_t bytes_of(const View& view);

// Patch i of one set becomes patch j of another.
void copy_patch(const PatchSet& from, int i, int j, PatchSet* to);
// Patches about pixels in an octave of a picture.
void extract_patches(const Octaves& picture, int octave, std::span<const Eigen::Vector2f> pixels,
                     PatchSet* patches);

// What matching needs of a key frame, beside its geometry in the map. The vectors run over the features of
// the map's key frame.
struct KeyFrameView {
  ViewPtr view;
  std::vector<uint8_t> cameras;
  std::vector<Eigen::Vector2f> pixels;
  std::vector<uint8_t> octaves;  // of the patches
  PatchSet patches;
  std::vector<Eigen::Vector3f> origins, directions;  // of the rays, in their camera's frame
  // d point / d pixel over its distance, on the surface about it: d direction / d pixel while nothing is
  // known of that (see fit_surfaces()). Zero where there is none.
  std::vector<Eigen::Matrix<float, 3, 2>> point_jacobians;

  const CameraView& camera_view(int feature) const { return view->cameras[cameras[feature]]; }
};

// Of the ray of a feature, in its camera's frame.
inline Eigen::Vector3d point_on_ray(const KeyFrameView& keyframe, int feature, double distance) {
  return keyframe.origins[feature].cast<double>() + distance * keyframe.directions[feature].cast<double>();
}

// Views and rays of a key frame's features, in the map's order. Features from `first_corner` on are corners
// of the view, in their order, whose patches it has.
KeyFrameView make_keyframe_view(ViewPtr view, const MapKeyFrame& keyframe, const TrackingRig& rig,
                                int first_corner = std::numeric_limits<int>::max());

// The rays again, of cameras or scan offsets that are no longer those that it was made with.
void renew_rays(const TrackingRig& rig, const MapKeyFrame& keyframe, KeyFrameView* view);
// That of one feature.
void renew_ray(const TrackingRig& rig, const MapKeyFrame& keyframe, int feature, KeyFrameView* view);

}  // namespace raysfm
