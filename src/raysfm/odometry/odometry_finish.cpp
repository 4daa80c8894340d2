// What Odometry does when there are no more frames.
#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "raysfm/core/heap.h"
#include "raysfm/odometry/odometry.h"

namespace raysfm {

Reconstruction Odometry::finish(bool final_adjustment, std::vector<Map>* kept_maps) {
  if (!tracking() && options_.starts_worlds) {
    if (auto start = starter_->finish(mapper_)) {
      const std::vector<WaitingView> views = starter_->views();
      starter_.emplace(rig_, options_);
      begin_segment(std::move(*start), views);
      go_through_waiting();
    } else {
      begin_turned_worlds();
      const int pictures = frames_.empty() ? 0 : frames_.back().rank + (frames_.back().same_as < 0);
      const std::string reason =
          pictures < frames() && pictures < 3
              ? fmt::format("no motion: {} frames show {} different pictures", frames(), pictures)
              : starter_->reason();
      for (FrameRecord& frame : frames_) {
        if (frame.segment < 0 && frame.reason.empty()) frame.reason = "no start: " + reason;
      }
    }
  }
  if (tracking()) remember_end();
  release_views();
  if (!only_turns()) {
    const std::vector<int> numbers = numbers_of_segments();
    for (int s = 0; s < static_cast<int>(numbers.size()); ++s) {
      if (numbers[s] >= 0) refine_calibration(s, true);
    }
    if (options_.finishes_maps) finish_maps(final_adjustment);
    finish_covariances();
  }
  for (int i = 0; i < frames(); ++i) settle(i);
  std::vector<Map> maps;
  for (SegmentState& s : segments_) maps.push_back(std::move(s.map));
  if (kept_maps) {
    kept_maps->clear();
    for (size_t s = 0; s < maps.size(); ++s) {
      if (segments_[s].joined_into < 0) kept_maps->push_back(maps[s]);
    }
  }
  return assemble(std::move(maps));
}

// All worlds as the last calibration has them, adjusted for the last time.
void Odometry::finish_maps(bool final_adjustment) {
  const int worlds = static_cast<int>(segments_.size());
  for (int s = 0; s < worlds; ++s) {
    const SegmentState& segment = segments_[s];
    if (segment.joined_into >= 0) continue;
    if (segment.calibration != calibration_ || segment.closed || rig_.scans()) adapt(s, 0, whole_adaption(s));
    if (final_adjustment) adjust_finally(s);
  }
  const std::vector<Rig> deviations = refiner_.deviations();
  for (int s = 0; s < worlds; ++s) {
    if (segments_[s].joined_into >= 0) continue;
    find_scale(s, deviations);
    if (segments_[s].closed || rig_.scans()) adjust_to_noise(s);
  }
}

void Odometry::adjust_finally(int number) {
  adjust(number, [&](Map* map) {
    if (options_.final == FinalAdjustment::kGlobal) {
      mapper_.adjust_globally(map);
    } else {
      mapper_.adjust_hierarchically(map);
    }
  });
}

// What is left of the error of a map that was adjusted as a whole comes from matches that are wrong by less
// than an inlier may be: where loops hold it together, and where a shutter rolls.
void Odometry::adjust_to_noise(int number) {
  adjust(number, [&](Map* map) { mapper_.adjust_to_noise(map); });
}

// What only more views would need. To give memory back and to take it anew is dear: a map of no more key
// frames than had views is adjusted in what these leave.
void Odometry::release_views() {
  previous_.reset();
  starter_.reset();
  local_ = {};
  places_.forget();
  size_t most_keyframes = 0;
  for (SegmentState& s : segments_) {
    s.views = std::vector<KeyFrameView>();
    most_keyframes = std::max(most_keyframes, s.map.keyframes.size());
  }
  if (most_keyframes > kKeptViews) return_freed_memory();
}

// All poses moved with what became known of the calibration.
void Odometry::finish_covariances() {
  const std::vector<Rig> deviations = refiner_.deviations();
  for (int s = 0; s < static_cast<int>(segments_.size()); ++s) {
    if (segments_[s].joined_into >= 0) continue;
    if (!deviations.empty()) {
      map_covariance_.measure_all(rig_, deviations, segments_[s].map, s);
    } else if (s == active_) {
      map_covariance_.measure(rig_, {}, segments_[s].map, s);
    }
  }
}

}  // namespace raysfm
