#include "raysfm/solving/worlds_left_out.h"

#include <algorithm>
#include <functional>
#include <utility>

#include "raysfm/core/thread_pool.h"
#include "raysfm/scene/frame_lens.h"

namespace raysfm {
namespace {

// Of the observations of a world that is not the main one: they are 0.97 to 1 of nine right ones, of lots of
// 9 to 24 photos, and 0.57 and 0.76 of two wrong ones.
constexpr double kAgreeingInSmall = 0.85;
constexpr int kLeastImages = 3;  // of a world

// A reconstruction of a part of the observations as one of all.
void number_inliers(const std::vector<int>& observations, int count, RayReconstruction* found) {
  std::vector<uint8_t> inlier(count, 0);
  for (size_t i = 0; i < observations.size(); ++i) inlier[observations[i]] = found->inlier[i];
  found->inlier = std::move(inlier);
}

}  // namespace

RayOptions ray_options(const SolveInput& input, const SolveSettings& settings,
                       const SolveCallbacks& callbacks) {
  RayOptions options{.max_error_px = settings.max_error,
                     .in_order = false,
                     .seed = settings.seed,
                     .threads = thread_count(settings.threads),
                     .stopped = [&callbacks] { return callbacks.stopped(); }};
  if (callbacks.progress) {
    options.progress = [&callbacks, photos = static_cast<int>(input.names.size())](int posed) {
      callbacks.progress("photo", posed, photos);
    };
  }
  return options;
}

std::vector<RayReconstruction> worlds_left_out(const SolveInput& input, std::span<const uint8_t> posed,
                                               const Camera& camera, const SolveSettings& settings,
                                               const SolveCallbacks& callbacks) {
  RayOptions options = ray_options(input, settings, callbacks);
  options.is_known = true;
  options.progress = nullptr;
  std::vector<RayReconstruction> worlds;
  std::vector<uint8_t> left(posed.size());
  std::ranges::transform(posed, left.begin(), [](uint8_t is_posed) { return !is_posed; });
  while (std::ranges::count(left, 1) >= kLeastImages && !callbacks.stopped()) {
    std::vector<int> observations;
    const PointTracks tracks = seen_by(input.tracks, left, 2, &observations);
    RayReconstruction found = reconstruct_along_rays(tracks, camera, options);
    if (found.posed == 0) break;
    for (size_t j = 0; j < left.size(); ++j) left[j] &= !found.image_posed[j];
    if (found.posed < kLeastImages || agreeing_share(tracks, found) < kAgreeingInSmall) continue;
    number_inliers(observations, input.tracks.size(), &found);
    worlds.push_back(std::move(found));
  }
  std::ranges::stable_sort(worlds, std::greater<>(), &RayReconstruction::posed);
  return worlds;
}

std::vector<RayReconstruction> worlds_left_out(const SolveInput& input,
                                               const UncalibratedReconstruction& found,
                                               const SolveSettings& settings,
                                               const SolveCallbacks& callbacks) {
  const int first = found.first_posed();
  if (input.in_order || found.zooming || found.world_is_given || first < 0) return {};
  Camera camera = frame_lens(found.scene.lenses[first], found.radial).camera;
  camera.width = static_cast<int>(input.tracks.image_size.x());
  camera.height = static_cast<int>(input.tracks.image_size.y());
  return worlds_left_out(input, found.image_posed, camera, settings, callbacks);
}

}  // namespace raysfm
