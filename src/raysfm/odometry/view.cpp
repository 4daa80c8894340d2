#include "raysfm/odometry/view.h"

#include <algorithm>
#include <cmath>

#include "raysfm/core/timer.h"
#include "raysfm/image/pyramid.h"

namespace raysfm {
namespace {

constexpr int kThumbnailWidth = 96;  // pixels at most

}  // namespace

void detect(HarrisDetector& detector, const HarrisOptions& options, View* view) {
  const Clock::time_point start = Clock::now();
  const GrayView image = view->image.view();
  detector.detect(image, options, &view->features);
  extract_patches(image, view->features.pixels, &view->patches);
  view->grid.build(view->features.pixels, image.width, image.height);
  view->thumbnail_scale = make_thumbnail(image, kThumbnailWidth, &view->thumbnail);
  view->detect_ms = milliseconds_since(start);
}

CoarseMotion coarse_motion(const View& first, const View& second) {
  return estimate_coarse_motion(first.thumbnail, second.thumbnail, static_cast<float>(first.thumbnail_scale));
}

std::array<uint8_t, 3> color_at(const View& view, const Eigen::Vector2f& pixel) {
  const int x = std::clamp(static_cast<int>(std::lround(pixel.x())), 0, view.image.width() - 1);
  const int y = std::clamp(static_cast<int>(std::lround(pixel.y())), 0, view.image.height() - 1);
  if (view.bgr.empty()) {
    const uint8_t grey = view.image.row(y)[x];
    return {grey, grey, grey};
  }
  const uint8_t* bgr = view.bgr.row(y) + 3 * x;
  return {bgr[2], bgr[1], bgr[0]};
}

KeyFrameView make_keyframe_view(ViewPtr view, const MapKeyFrame& keyframe, const Camera& camera) {
  KeyFrameView out;
  out.pixels = keyframe.pixels;
  extract_patches(view->image.view(), out.pixels, &out.patches);
  out.directions.resize(keyframe.size());
  out.ray_jacobians.resize(keyframe.size());
  for (int i = 0; i < keyframe.size(); ++i) {
    // Central differences over a pixel: the jacobian shapes patches, it does not enter an estimate.
    const Eigen::Vector2d pixel = keyframe.pixels[i].cast<double>();
    Ray center, plus, minus;
    Eigen::Matrix<double, 3, 2> jacobian = Eigen::Matrix<double, 3, 2>::Zero();
    bool ok = camera.ray(pixel, &center);
    for (int c = 0; c < 2 && ok; ++c) {
      const Eigen::Vector2d step = 0.5 * Eigen::Vector2d::Unit(c);
      ok = camera.ray(pixel + step, &plus) && camera.ray(pixel - step, &minus);
      if (ok) jacobian.col(c) = plus.direction - minus.direction;
    }
    out.directions[i] = center.direction.cast<float>();
    out.ray_jacobians[i] = jacobian.cast<float>();
  }
  out.view = std::move(view);
  return out;
}

}  // namespace raysfm
