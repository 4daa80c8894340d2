#include "raysfm/views/view.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "raysfm/camera/projection_inverse.h"
#include "raysfm/image/pyramid.h"

namespace raysfm {
namespace {

constexpr int kThumbnailWidth = 96;  // pixels at most
// Corners of the second octave are what is left of a corner under motion blur. Their share of all grows with
// the width of the edges (Octaves::softness()), from where cameras' pixels are used to the full. Where all
// pictures are that sharp they would only push better ones out: a fixed share of a fifth costs kitti07-mono
// an eighth of its accuracy, none at all costs phone-batmobile a fifth of its frames.
constexpr float kSharp = 0.6f, kMaxCoarseShare = 0.5f;
// Of the finest octave: more of them cost more time than they add to what can be seen.
constexpr int kMaxPixels = 5 << 19;

int coarse_features(const Octaves& octaves, int all) {
  const float share = std::clamp(octaves.softness() - kSharp, 0.0f, kMaxCoarseShare);
  return static_cast<int>(share * static_cast<float>(all));
}

void append(const Features& more, Features* features) {
  features->pixels.insert(features->pixels.end(), more.pixels.begin(), more.pixels.end());
  features->scores.insert(features->scores.end(), more.scores.begin(), more.scores.end());
  features->octaves.insert(features->octaves.end(), more.octaves.begin(), more.octaves.end());
}

// Calls f(octave, indices) for the elements of each octave there is.
template <typename F>
void for_each_octave(std::span<const uint8_t> octaves, F f) {
  std::vector<int> indices;
  uint32_t present = 0;
  for (const uint8_t octave : octaves) present |= uint32_t{1} << octave;
  for (int octave = 0; present >> octave != 0; ++octave) {
    if ((present >> octave & 1) == 0) continue;
    indices.clear();
    for (size_t i = 0; i < octaves.size(); ++i) {
      if (octaves[i] == octave) indices.push_back(static_cast<int>(i));
    }
    f(octave, std::as_const(indices));
  }
}

// The patches of features from one on that are corners, in their order: patches of corners are known. Returns
// which features are not.
std::vector<uint8_t> copy_corner_patches(int first_corner, KeyFrameView* out) {
  std::vector<uint8_t> is_open(out->pixels.size(), 1);
  std::vector<int> next(out->view->cameras.size(), 0);  // corner of each camera
  for (int f = first_corner; f < static_cast<int>(out->pixels.size()); ++f) {
    const CameraView& camera = out->view->cameras[out->cameras[f]];
    const Features& corners = camera.features;
    int& i = next[out->cameras[f]];
    while (i < corners.size() &&
           !(corners.pixels[i] == out->pixels[f] && corners.octaves[i] == out->octaves[f])) {
      ++i;
    }
    if (i == corners.size()) break;
    copy_patch(camera.patches, i++, f, &out->patches);
    is_open[f] = 0;
  }
  return is_open;
}

void extract_keyframe_patches(int first_corner, KeyFrameView* out) {
  std::vector<int> indices;
  std::vector<Eigen::Vector2f> pixels;
  PatchSet patches;
  out->patches.resize(static_cast<int>(out->pixels.size()));
  const std::vector<uint8_t> is_open = copy_corner_patches(first_corner, out);
  for_each_octave(out->octaves, [&](int octave, const std::vector<int>& of_octave) {
    for (int c = 0; c < static_cast<int>(out->view->cameras.size()); ++c) {
      indices.clear();
      pixels.clear();
      for (const int i : of_octave) {
        if (out->cameras[i] != c || !is_open[i]) continue;
        indices.push_back(i);
        pixels.push_back(out->pixels[i]);
      }
      if (pixels.empty()) continue;  // a small image may not have the octave at all
      extract_patches(*out->view->cameras[c].octaves, octave, pixels, &patches);
      for (int k = 0; k < patches.size(); ++k) copy_patch(patches, k, indices[k], &out->patches);
    }
  });
}

// Corners of both octaves, with a grid for each.
void find_corners(HarrisDetector& detector, const HarrisOptions& options, CameraView* view) {
  const Octaves& octaves = *view->octaves;
  HarrisOptions in_octave = options;
  Features found;
  view->features.clear();
  view->grids.clear();
  for (int o = view->first_octave(); o <= view->last_octave(); ++o) {
    in_octave.octave = o;
    const int there = view->features.size();
    in_octave.max_features =
        o == octaves.first()
            ? options.max_features - coarse_features(octaves, options.max_features)
            : std::max(coarse_features(octaves, options.max_features), options.max_features / 4 - there);
    detector.detect(octaves.at(o), in_octave, &found);
    append(found, &view->features);
    view->grids.emplace_back().build(view->features.pixels, there, view->features.size(), view->width,
                                     view->height, o);
  }
}

void extract_corner_patches(CameraView* view) {
  const Features& features = view->features;
  PatchSet patches;
  view->patches.resize(features.size());
  for_each_octave(features.octaves, [&](int octave, const std::vector<int>& indices) {
    const std::span pixels = std::span(features.pixels).subspan(indices.front(), indices.size());
    extract_patches(*view->octaves, octave, pixels, &patches);
    for (int k = 0; k < patches.size(); ++k) copy_patch(patches, k, indices[k], &view->patches);
  });
}

// Of the pixels nearest to the features.
void take_colors(CameraView* view) {
  static const ColorPlanes kGrey;
  const ColorPlanes& colors = view->colors ? *view->colors : kGrey;
  const int octave = view->octaves->first();
  const GrayView image = view->octaves->at(octave);
  view->rgb.clear();
  for (const Eigen::Vector2f& pixel : view->features.pixels) {
    const int x = std::clamp(static_cast<int>(std::lround(pixel.x())), 0, view->width - 1);
    const int y = std::clamp(static_cast<int>(std::lround(pixel.y())), 0, view->height - 1);
    const uint8_t grey =
        image(std::min(x >> octave, image.width - 1), std::min(y >> octave, image.height - 1));
    view->rgb.push_back(colors.at(view->origin.x() + x, view->origin.y() + y, grey));
  }
}

}  // namespace

void copy_patch(const PatchSet& from, int i, int j, PatchSet* to) {
  std::memcpy(to->mutable_patch(j), from.patch(i), kPatchStride);
  to->set_inverse_norm(j, from.inverse_norm(i));
}

void extract_patches(const Octaves& picture, int octave, std::span<const Eigen::Vector2f> pixels,
                     PatchSet* patches) {
  std::vector<Eigen::Vector2f> in_octave;
  for (const Eigen::Vector2f& pixel : pixels) in_octave.push_back(into_octave(pixel, octave));
  extract_patches(picture.at(octave), in_octave, patches);
}

void look(CameraView* view) {
  view->width = view->image.width();
  view->height = view->image.height();
  view->octaves = std::make_shared<const Octaves>(std::move(view->image), kMaxPixels);
  view->image = {};
  const Octaves& octaves = *view->octaves;
  int source = octaves.first();
  while (source < octaves.last() && octaves.at(source).width > kThumbnailWidth) ++source;
  GrayImage thumbnail;
  view->thumbnail_scale = make_thumbnail(octaves.at(source), kThumbnailWidth, &thumbnail) << source;
  view->thumbnail = std::make_shared<const GrayImage>(std::move(thumbnail));
}

void detect(HarrisDetector& detector, const HarrisOptions& options, CameraView* view) {
  if (!view->octaves) look(view);
  find_corners(detector, options, view);
  extract_corner_patches(view);
  take_colors(view);
  view->colors.reset();
}

ViewPtr images_of(const View& view) {
  return coarser_images_of(view, 0);
}

ViewPtr coarser_images_of(const View& view, int octaves) {
  auto images = std::make_shared<View>(view.stamp());
  for (const CameraView& camera : view.cameras) {
    CameraView& image = images->cameras.emplace_back();
    image.width = camera.width;
    image.height = camera.height;
    image.octaves = octaves > 0 ? std::make_shared<const Octaves>(camera.octaves->without_finest(octaves))
                                : camera.octaves;
    image.thumbnail = camera.thumbnail;
    image.thumbnail_scale = camera.thumbnail_scale;
  }
  return images;
}

size_t bytes_of(const View& view) {
  size_t bytes = 0;
  for (const CameraView& camera : view.cameras)
    bytes += camera.octaves->bytes() + size_t{kPatchStride} * camera.patches.size();
  return bytes;
}

CoarseMotion coarse_motion(const CameraView& first, const CameraView& second) {
  return estimate_coarse_motion(*first.thumbnail, *second.thumbnail,
                                static_cast<float>(first.thumbnail_scale));
}

KeyFrameView make_keyframe_view(ViewPtr view, const MapKeyFrame& keyframe, const TrackingRig& rig,
                                int first_corner) {
  KeyFrameView out;
  out.view = std::move(view);
  out.cameras.assign(keyframe.cameras.begin(), keyframe.cameras.end());
  out.pixels.assign(keyframe.pixels.begin(), keyframe.pixels.end());
  out.octaves.assign(keyframe.octaves.begin(), keyframe.octaves.end());
  out.origins.resize(keyframe.size());
  out.directions.resize(keyframe.size());
  out.point_jacobians.resize(keyframe.size());
  for (int i = 0; i < keyframe.size(); ++i) {
    const Camera& camera = rig.camera(keyframe.cameras[i]);
    const Eigen::Vector2d pixel = keyframe.instant_pixel(i).cast<double>();
    Ray ray;
    // The jacobian shapes patches, it does not enter an estimate.
    Eigen::Matrix<double, 3, 2> jacobian;
    const bool seen = camera.ray(pixel, &ray) &&
                      (invert_projection(camera, ray, &jacobian) || ray_jacobian(camera, pixel, &jacobian));
    if (!seen) jacobian.setZero();
    out.origins[i] = ray.origin.cast<float>();
    out.directions[i] = ray.direction.cast<float>();
    out.point_jacobians[i] = jacobian.cast<float>();
  }
  extract_keyframe_patches(std::min(first_corner, keyframe.size()), &out);
  return out;
}

void renew_ray(const TrackingRig& rig, const MapKeyFrame& keyframe, int feature, KeyFrameView* view) {
  Ray ray;
  const Camera& camera = rig.camera(view->cameras[feature]);
  if (!camera.ray(keyframe.instant_pixel(feature).cast<double>(), &ray)) return;
  view->origins[feature] = ray.origin.cast<float>();
  view->directions[feature] = ray.direction.cast<float>();
}

void renew_rays(const TrackingRig& rig, const MapKeyFrame& keyframe, KeyFrameView* view) {
  for (int f = 0; f < static_cast<int>(view->pixels.size()); ++f) renew_ray(rig, keyframe, f, view);
}

}  // namespace raysfm
