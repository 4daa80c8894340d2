#include "raysfm/scene/worlds.h"

#include <algorithm>

namespace raysfm {
namespace {

bool belongs(const PosedFrame& frame, int segment) {
  return frame.world_from_rig && frame.segment == segment;
}

// Appends the members of the segment to `to` and returns the new number of each, -1 of the others.
template <typename T, typename Belongs>
std::vector<int> keep(const std::vector<T>& from, Belongs belongs, std::vector<T>* to) {
  std::vector<int> number(from.size(), -1);
  for (size_t i = 0; i < from.size(); ++i) {
    if (!belongs(from[i])) continue;
    number[i] = static_cast<int>(to->size());
    to->push_back(from[i]);
    to->back().segment = 0;
  }
  return number;
}

void keep_keyframes(const Reconstruction& from, const std::vector<int>& frame_number,
                    const std::vector<int>& point_number, Reconstruction* to) {
  for (const KeyFrame& k : from.keyframes) {
    if (frame_number[k.frame] < 0) continue;
    KeyFrame keyframe{frame_number[k.frame], static_cast<int>(to->observations.size()), 0};
    for (int i = k.first_observation; i < k.last_observation; ++i) {
      const int point = point_number[from.observations[i].point];
      if (point < 0) continue;
      to->observations.push_back(from.observations[i]);
      to->observations.back().point = point;
    }
    keyframe.last_observation = static_cast<int>(to->observations.size());
    to->keyframes.push_back(keyframe);
  }
}

}  // namespace

std::vector<int> worlds_in_order(const Reconstruction& reconstruction) {
  std::vector<int> posed(reconstruction.segments.size(), 0), order;
  for (const PosedFrame& frame : reconstruction.frames) {
    if (frame.world_from_rig && frame.segment >= 0) ++posed[frame.segment];
  }
  for (size_t s = 0; s < posed.size(); ++s) {
    if (posed[s] > 0) order.push_back(static_cast<int>(s));
  }
  const auto main = std::ranges::max_element(order, {}, [&](int s) { return posed[s]; });
  if (main != order.end()) std::rotate(order.begin(), main, main + 1);
  return order;
}

Reconstruction world_of(const Reconstruction& reconstruction, int segment) {
  Reconstruction world;
  world.origin = reconstruction.origin;
  world.rig = reconstruction.rig;
  world.range = reconstruction.range;
  world.lenses = reconstruction.lenses;
  world.rms_reprojection_px = reconstruction.rms_reprojection_px;
  world.segments.push_back(reconstruction.segments[segment]);
  world.metric_scale = world.segments[0].metric_scale;
  world.scale_sigma = world.segments[0].scale_sigma;
  const std::vector<int> frame_number = keep(
      reconstruction.frames, [&](const PosedFrame& f) { return belongs(f, segment); }, &world.frames);
  const std::vector<int> point_number = keep(
      reconstruction.points, [&](const MapPoint& p) { return p.segment == segment; }, &world.points);
  keep_keyframes(reconstruction, frame_number, point_number, &world);
  world.segments[0].first = 0;
  world.segments[0].last = static_cast<int>(world.frames.size()) - 1;
  if (segment < static_cast<int>(reconstruction.starts.size())) {
    world.starts.push_back(reconstruction.starts[segment]);
    for (int& frame : world.starts[0].frames) frame = frame_number[frame];
  }
  return world;
}

int posed_count(const Reconstruction& reconstruction) {
  return static_cast<int>(std::ranges::count_if(
      reconstruction.frames, [](const PosedFrame& f) { return f.world_from_rig.has_value(); }));
}

int placed_count(const Reconstruction& reconstruction) {
  return static_cast<int>(std::ranges::count_if(reconstruction.frames, [](const PosedFrame& f) {
    return f.world_from_rig.has_value() && !f.place_held;
  }));
}

std::vector<FrameRun> place_held_runs(const std::vector<PosedFrame>& frames) {
  std::vector<FrameRun> runs;
  for (size_t i = 0; i < frames.size(); ++i) {
    if (!frames[i].place_held) continue;
    if (i == 0 || !frames[i - 1].place_held) runs.push_back({i, i});
    runs.back().last = i;
  }
  return runs;
}

}  // namespace raysfm
