#include "raysfm/api/solve_stretches.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "raysfm/core/thread_pool.h"
#include "raysfm/photos/track_bridges.h"

namespace raysfm {

void join_stretches(const SolveSettings& settings, const SolveCallbacks& callbacks, SolveInput* input) {
  if (input->described.empty() || callbacks.stopped()) return;
  ThreadPool pool(thread_count(settings.threads) - 1);
  StageTiming time;
  {
    const ScopedTimer timer(time);
    const std::vector<TrackBridge> bridges = find_bridges(
        input->tracks, input->described, settings.max_error, settings.seed, callbacks.stop, &pool);
    for (const auto& b : bridges)
      tell(callbacks.event, Event::Level::kInfo, fmt::format("bridge {} {}: {} {:.1f}", b.images[0], b.images[1], b.same.size(), b.log10_false_alarms));
    std::vector<int> images;
    for (const auto& d : input->described) images.push_back(d.image);
    const auto st = stretches_of(input->tracks, images);
    for (size_t i = 1; i < st.size(); ++i) if (st[i] != st[i-1]) tell(callbacks.event, Event::Level::kInfo, fmt::format("new stretch at {} (key {})", images[i], i));
    if (!bridges.empty()) {
      const std::vector<int> number = join_points(bridges, &input->tracks);
      std::vector<std::array<uint8_t, 3>> rgb(input->tracks.point_count);
      for (size_t i = number.size(); i-- > 0;) rgb[number[i]] = input->rgb[i];
      input->rgb = std::move(rgb);
    }
  }
  input->stages.emplace_back("join", time);
  input->described.clear();
}

}  // namespace raysfm
