#include "raysfm/solving/joined_stretches.h"

#include <fmt/format.h>

#include <span>
#include <utility>

#include "raysfm/core/thread_pool.h"
#include "raysfm/photos/track_bridges.h"

namespace raysfm {
namespace {

// Numbers all that is kept of points as join_points() did.
void renumber(const std::vector<int>& number, JoinedStretches* joined) {
  SolveInput& input = joined->input;
  std::vector<std::array<uint8_t, 3>> rgb(input.tracks.point_count);
  for (size_t i = number.size(); i-- > 0;) rgb[number[i]] = input.rgb[i];
  input.rgb = std::move(rgb);
  input.described.clear();
  if (!joined->start) return;
  renumber_points(number, input.tracks.point_count, &joined->start->scene.points,
                  &joined->start->point_placed);
}

bool left_keyframes_out(const SolveInput& input, const UncalibratedReconstruction* found) {
  for (size_t j = 0; j < input.keyframe.size(); ++j) {
    if (input.keyframe[j] && !(found && found->image_posed[j])) return true;
  }
  return false;
}

}  // namespace

std::optional<JoinedStretches> joined_stretches(const SolveInput& input,
                                                const UncalibratedReconstruction* found,
                                                const SolveSettings& settings,
                                                const SolveCallbacks& callbacks) {
  if (input.described.empty() || callbacks.stopped() || !left_keyframes_out(input, found)) return {};
  StageTiming time;
  JoinedStretches joined;
  {
    const ScopedTimer timer(time);
    ThreadPool pool(thread_count(settings.threads) - 1);
    std::span<const uint8_t> posed;
    if (found) posed = found->image_posed;
    const std::vector<TrackBridge> bridges = find_bridges(
        input.tracks, input.described, posed, settings.max_error, settings.seed, callbacks.stop, &pool);
    if (bridges.empty()) return {};
    joined.input = input;
    if (found) joined.start = *found;
    renumber(join_points(bridges, &joined.input.tracks), &joined);
    tell(callbacks.event, Event::Level::kInfo,
         fmt::format("tracks are broken: {} pairs of key frames see the same places", bridges.size()));
  }
  joined.input.stages.emplace_back("join", time);
  return joined;
}

}  // namespace raysfm
