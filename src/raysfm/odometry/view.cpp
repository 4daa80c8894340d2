#include "raysfm/odometry/view.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "raysfm/image/pyramid.h"

namespace raysfm {
namespace {

constexpr int kThumbnailWidth = 96;  // pixels at most

void extract_keyframe_patches(KeyFrameView* out) {
  std::vector<int> indices;
  std::vector<Eigen::Vector2f> pixels;
  PatchSet patches;
  out->patches.resize(static_cast<int>(out->pixels.size()));
  for (int c = 0; c < static_cast<int>(out->view->cameras.size()); ++c) {
    indices.clear();
    pixels.clear();
    for (size_t i = 0; i < out->pixels.size(); ++i) {
      if (out->cameras[i] != c) continue;
      indices.push_back(static_cast<int>(i));
      pixels.push_back(out->pixels[i]);
    }
    extract_patches(out->view->cameras[c].image.view(), pixels, &patches);
    for (int k = 0; k < patches.size(); ++k) copy_patch(patches, k, indices[k], &out->patches);
  }
}

}  // namespace

void copy_patch(const PatchSet& from, int i, int j, PatchSet* to) {
  std::memcpy(to->mutable_patch(j), from.patch(i), kPatchStride);
  to->set_inverse_norm(j, from.inverse_norm(i));
}

void detect(HarrisDetector& detector, const HarrisOptions& options, CameraView* view) {
  const GrayView image = view->image.view();
  detector.detect(image, options, &view->features);
  extract_patches(image, view->features.pixels, &view->patches);
  view->grid.build(view->features.pixels, image.width, image.height);
  view->thumbnail_scale = make_thumbnail(image, kThumbnailWidth, &view->thumbnail);
}

CoarseMotion coarse_motion(const CameraView& first, const CameraView& second) {
  return estimate_coarse_motion(first.thumbnail, second.thumbnail, static_cast<float>(first.thumbnail_scale));
}

std::array<uint8_t, 3> color_at(const CameraView& view, const Eigen::Vector2f& pixel) {
  const int x = std::clamp(static_cast<int>(std::lround(pixel.x())), 0, view.image.width() - 1);
  const int y = std::clamp(static_cast<int>(std::lround(pixel.y())), 0, view.image.height() - 1);
  if (view.bgr.empty()) {
    const uint8_t grey = view.image.row(y)[x];
    return {grey, grey, grey};
  }
  const uint8_t* bgr = view.bgr.row(y) + 3 * x;
  return {bgr[2], bgr[1], bgr[0]};
}

KeyFrameView make_keyframe_view(ViewPtr view, const MapKeyFrame& keyframe, const TrackingRig& rig) {
  KeyFrameView out;
  out.view = std::move(view);
  out.cameras = keyframe.cameras;
  out.pixels = keyframe.pixels;
  out.origins.resize(keyframe.size());
  out.directions.resize(keyframe.size());
  out.ray_jacobians.resize(keyframe.size());
  for (int i = 0; i < keyframe.size(); ++i) {
    const Camera& camera = rig.camera(keyframe.cameras[i]);
    const Eigen::Vector2d pixel = keyframe.pixels[i].cast<double>();
    Ray ray;
    // The jacobian shapes patches, it does not enter an estimate.
    Eigen::Matrix<double, 3, 2> jacobian;
    if (!camera.ray(pixel, &ray) || !ray_jacobian(camera, pixel, &jacobian)) jacobian.setZero();
    out.origins[i] = ray.origin.cast<float>();
    out.directions[i] = ray.direction.cast<float>();
    out.ray_jacobians[i] = jacobian.cast<float>();
  }
  extract_keyframe_patches(&out);
  return out;
}

}  // namespace raysfm
