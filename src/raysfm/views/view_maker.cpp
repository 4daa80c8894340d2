#include "raysfm/views/view_maker.h"

#include <algorithm>
#include <memory>
#include <utility>

#include "raysfm/core/timer.h"

namespace raysfm {
namespace {

// The part of a picture that a camera's image is.
GrayImage cropped(const GrayImage& picture, const Roi& roi) {
  GrayImage part(roi.w, roi.h);
  for (int y = 0; y < roi.h; ++y) std::copy_n(picture.row(roi.y + y) + roi.x, roi.w, part.row(y));
  return part;
}

// Of the corners of a cell, in even shares (corner_selection.h). 1.2 to 3 were tried.
constexpr float kMostShares = 1.5f;

// Of the corners of `from` that are nearest.
void take_colors(const CameraView& from, CameraView* view) {
  if (from.features.size() == 0) return;
  for (int i = 0; i < view->features.size(); ++i) {
    const auto distance2 = [&](const Eigen::Vector2f& p) {
      return (p - view->features.pixels[i]).squaredNorm();
    };
    const auto nearest = std::ranges::min_element(from.features.pixels, {}, distance2);
    view->rgb[i] = from.rgb[nearest - from.features.pixels.begin()];
  }
}

// A view as look() left it.
std::shared_ptr<View> looked_at(const View& view) {
  auto copy = std::make_shared<View>(view.stamp());
  for (const CameraView& camera : view.cameras) {
    copy->cameras.emplace_back().CameraImage::operator=(camera);
  }
  return copy;
}

}  // namespace

ViewMaker::ViewMaker(std::vector<CameraInput> cameras) : cameras_(std::move(cameras)) {
  for (const CameraInput& camera : cameras_) {
    const auto users = std::ranges::count(cameras_, camera.stream, &CameraInput::stream);
    owns_stream_.push_back(users == 1 && camera.roi.w == 0);
  }
}

void ViewMaker::look(std::vector<Picture> pictures, View* view) const {
  const Clock::time_point start = Clock::now();
  std::vector<std::shared_ptr<const ColorPlanes>> colors;
  for (Picture& picture : pictures) {
    colors.push_back(picture.colors.empty() ? nullptr
                                            : std::make_shared<ColorPlanes>(std::move(picture.colors)));
  }
  for (size_t c = 0; c < cameras_.size(); ++c) {
    GrayImage& picture = pictures[cameras_[c].stream].gray;
    Roi roi = cameras_[c].roi;
    if (roi.w == 0) roi = {0, 0, picture.width(), picture.height()};
    CameraView& camera = view->cameras.emplace_back();
    camera.image = owns_stream_[c] ? std::move(picture) : cropped(picture, roi);
    camera.colors = colors[cameras_[c].stream];
    camera.origin = {roi.x, roi.y};
    raysfm::look(&camera);
  }
  view->detect_ms += milliseconds_since(start);
}

void ViewMaker::find_corners(bool evenly, View* view) const {
  thread_local HarrisDetector detector;  // scratch
  const Clock::time_point start = Clock::now();
  for (size_t c = 0; c < view->cameras.size(); ++c) {
    HarrisOptions options = cameras_[c].harris;
    if (evenly) options.shares.most = kMostShares;
    raysfm::detect(detector, options, &view->cameras[c]);
  }
  view->evenly = evenly;
  view->detect_ms += milliseconds_since(start);
}

void ViewMaker::detect(View* view) const {
  if (!view->detected()) find_corners(false, view);
}

ViewPtr ViewMaker::detected(const ViewPtr& view) const {
  if (view->detected()) return view;
  auto copy = looked_at(*view);
  detect(copy.get());
  return copy;
}

ViewPtr ViewMaker::detected_evenly(const ViewPtr& view) const {
  if (view->evenly) return view;
  const ViewPtr strongest = detected(view);
  auto even = looked_at(*strongest);
  find_corners(true, even.get());
  for (size_t c = 0; c < even->cameras.size(); ++c) take_colors(strongest->cameras[c], &even->cameras[c]);
  return even;
}

}  // namespace raysfm
