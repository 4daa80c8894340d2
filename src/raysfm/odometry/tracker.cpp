#include "raysfm/odometry/tracker.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "raysfm/matching/extrinsics_check.h"
#include "raysfm/views/sight_mask.h"

namespace raysfm {
namespace {

constexpr size_t kMostCameras = 256;  // the map numbers them by bytes

Result<void> check_rig(const Rig& rig, const TrackerOptions& options) {
  if (rig.cameras.empty()) return bad_input("rig: no cameras; at least one is needed");
  if (rig.cameras.size() > kMostCameras) {
    return bad_input(fmt::format("rig: {} cameras; {} at most", rig.cameras.size(), kMostCameras));
  }
  const size_t masks = options.masks.size();
  if (masks != 0 && masks != rig.cameras.size()) {
    return bad_input(
        fmt::format("masks: {} for {} cameras; one for each, or none", masks, rig.cameras.size()));
  }
  for (size_t c = 0; c < rig.cameras.size(); ++c) {
    const Camera& camera = rig.cameras[c];
    if (camera.width <= 0 || camera.height <= 0) {
      return bad_input(
          fmt::format("camera {}: resolution {} x {}; it must be known", c, camera.width, camera.height));
    }
    if (camera.stream < 0)
      return bad_input(fmt::format("camera {}: stream {}; at least 0", c, camera.stream));
    if (masks == 0 || options.masks[c].empty()) continue;
    const GrayImage& mask = options.masks[c];
    if (mask.width() == camera.width && mask.height() == camera.height) continue;
    return bad_input(fmt::format("masks[{}]: {} x {} pixels; that of its camera is {} x {}", c, mask.width(),
                                 mask.height(), camera.width, camera.height));
  }
  return {};
}

// What each camera of the rig is asked for. More cameras see more, but part of it more than once.
std::vector<CameraInput> camera_inputs(const Rig& rig, const std::vector<GrayImage>& masks, int features) {
  const int count = static_cast<int>(rig.cameras.size());
  std::vector<CameraInput> inputs;
  for (int c = 0; c < count; ++c) {
    CameraInput& input = inputs.emplace_back();
    input.stream = rig.cameras[c].stream;
    input.roi = rig.cameras[c].roi;
    input.harris.max_features = static_cast<int>(int64_t{2} * features / (count + 1));
    input.harris.mask = masks[c].view();
  }
  return inputs;
}

std::vector<GrayImage> sight_masks(const Rig& rig, std::vector<GrayImage> given) {
  given.resize(rig.cameras.size());
  for (size_t c = 0; c < given.size(); ++c) given[c] = sight_mask(rig.cameras[c], std::move(given[c]));
  return given;
}

}  // namespace

Result<std::unique_ptr<Tracker>> Tracker::create(const Rig& rig, TrackerOptions options,
                                                 TrackerObserver* observer) {
  if (auto r = check_rig(rig, options); !r) return r.error();
  if (auto r = validate(options.odometry); !r) return r.error();
  if (auto r = validate_error(rig, options.odometry.error); !r) return r.error();
  std::vector<GrayImage> masks = sight_masks(rig, std::move(options.masks));
  std::unique_ptr<Tracker> tracker(new Tracker(rig, std::move(masks), options.odometry, observer));
  tracker->odometry_.know(std::move(options.known_worlds));
  return tracker;
}

Tracker::Tracker(const Rig& rig, std::vector<GrayImage> masks, const OdometryOptions& options,
                 TrackerObserver* observer)
    : masks_(std::move(masks)),
      maker_(camera_inputs(rig, masks_, options.features)),
      odometry_(rig, options, observer, &maker_) {
  for (const Camera& camera : rig.cameras) streams_ = std::max(streams_, camera.stream + 1);
}

// Sizes are those of the streams: whole pictures, of which a camera may be a part.
Result<void> Tracker::check(std::span<const PixelView> images, double timestamp) const {
  if (static_cast<int>(images.size()) != streams_) {
    return bad_input(fmt::format("images: {} given; the rig has {} streams", images.size(), streams_));
  }
  if (!std::isfinite(timestamp) || (newest_ && timestamp <= *newest_)) {
    return bad_input(fmt::format("timestamp: {}; finite and above that of the frame before", timestamp));
  }
  for (const Camera& camera : odometry_.rig().cameras()) {
    const PixelView& image = images[camera.stream];
    if (image.empty()) continue;
    const Roi& roi = camera.roi;
    const bool fits = roi.w > 0 ? roi.x + roi.w <= image.width && roi.y + roi.h <= image.height
                                : image.width == camera.width && image.height == camera.height;
    if (fits) continue;
    return bad_input(fmt::format("images[{}]: {} x {} pixels; camera {} is {} x {}{}", camera.stream,
                                 image.width, image.height, camera.name, camera.width, camera.height,
                                 roi.w > 0 ? " and a part that reaches beyond" : ""));
  }
  return {};
}

Result<FrameResult> Tracker::push(std::span<const PixelView> images, double timestamp, std::string name) {
  if (auto r = check(images, timestamp); !r) return r.error();
  auto view = std::make_shared<View>();
  view->frame = frames();
  view->timestamp = timestamp;
  view->name = name.empty() ? fmt::format("frame-{:06}", frames()) : std::move(name);
  std::vector<Picture> pictures(images.size());
  for (size_t s = 0; s < images.size(); ++s) {
    if (images[s].empty()) {
      view->defect = fmt::format("no image of stream {}", s);
      return push(ViewPtr(std::move(view)));
    }
    copy_pixels(images[s], &pictures[s].gray, &pictures[s].colors);
  }
  std::vector<GrayView> grays;
  for (const Picture& picture : pictures) grays.push_back(picture.gray);
  view->repeats = repeats_.repeats();
  view->same_as = repeats_.original_of(view->frame, grays);
  if (view->same_as < 0) maker_.look(std::move(pictures), view.get());
  return push(ViewPtr(std::move(view)));
}

void Tracker::write_state(StateWriter& state) {
  archive(state, newest_, checked_, repeats_);
  odometry_.write_state(state);
}

bool Tracker::read_state(StateReader& state) {
  archive(state, newest_, checked_, repeats_);
  return odometry_.read_state(state);
}

Result<FrameResult> Tracker::push(ViewPtr view) {
  if (!checked_ && !view->cameras.empty()) {
    view = maker_.detected(view);
    if (auto problem = opposite_extrinsics(odometry_.rig(), *view)) return bad_input(*problem);
    checked_ = true;
  }
  newest_ = view->timestamp;
  return odometry_.process(std::move(view));
}

}  // namespace raysfm
