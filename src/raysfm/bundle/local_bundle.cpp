#include "raysfm/bundle/local_bundle.h"

#include <algorithm>
#include <string>

namespace raysfm {

Result<void> validate(const LocalBundleOptions& options) {
  if (options.free_cameras < 1) {
    return bad_input("free-cameras: " + std::to_string(options.free_cameras) + ": must be at least 1");
  }
  if (options.may_free_scale && options.window < options.free_cameras) {
    return bad_input("window: " + std::to_string(options.window) +
                     ": must be at least free-cameras = " + std::to_string(options.free_cameras));
  }
  const int64_t least_window = int64_t{options.free_cameras} + 2;
  if (!options.may_free_scale && options.window < least_window) {
    return bad_input("window: " + std::to_string(options.window) +
                     ": must be at least free-cameras + 2 = " + std::to_string(least_window) +
                     ", or the frame and the scale at the end of the sequence are free");
  }
  if (options.global_until < 0) {
    return bad_input("global-until: " + std::to_string(options.global_until) + ": must be at least 0");
  }
  return {};
}

LocalWindow local_window(int keyframe_count, const LocalBundleOptions& options) {
  if (keyframe_count <= options.global_until) return {};
  return {std::max(0, keyframe_count - options.window), std::max(0, keyframe_count - options.free_cameras)};
}

}  // namespace raysfm
