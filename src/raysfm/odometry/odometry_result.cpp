// What Odometry knows, as a Reconstruction.
#include <algorithm>
#include <cmath>
#include <utility>

#include "raysfm/odometry/odometry.h"
#include "raysfm/views/map_result.h"

namespace raysfm {
Reconstruction Odometry::snapshot() const {
  std::vector<Map> maps;
  for (const SegmentState& s : segments_) maps.push_back(s.map);
  Reconstruction out = assemble(std::move(maps));
  for (PosedFrame& frame : out.frames) {
    if (!frame.world_from_rig && frame.reason.empty()) frame.reason = waiting_reason();
  }
  return out;
}

NewestView Odometry::newest_view() const {
  constexpr size_t kShown = 3;
  if (!previous_) {
    const bool waits = starter_ && !starter_->views().empty();
    return {waits ? starter_->views().back().view : nullptr, {}};
  }
  NewestView newest{previous_->view, {}};
  const Map& map = segment().map;
  for (const PointMatch& m : previous_->pose.matches) {
    NewestView::Match& match = newest.matches.emplace_back(NewestView::Match{m.camera, m.pixel, {}});
    const auto& observations = map.tracks[m.track].observations;
    for (size_t i = observations.size(); i-- > 0 && match.before.size() < kShown;) {
      const MapKeyFrame& k = map.keyframes[observations[i].keyframe];
      const int feature = observations[i].feature;
      if (k.cameras[feature] == m.camera) match.before.push_back(k.pixels[feature]);
    }
  }
  return newest;
}

std::vector<ViewPtr> Odometry::newest_keyframes(int most) const {
  std::vector<ViewPtr> newest;
  if (active_ < 0) return newest;
  const std::vector<KeyFrameView>& views = segment().views;
  for (size_t k = views.size(); k-- > 0 && views[k].view && std::ssize(newest) < most;)
    newest.push_back(views[k].view);
  std::ranges::reverse(newest);
  return newest;
}

// From the map of each segment.
Reconstruction Odometry::assemble(std::vector<Map> maps) const {
  Reconstruction out;
  out.rig = rig_.rig();
  out.calibration = refiner_.numbers();
  out.closures = closures_;
  const std::vector<int> number_of = numbers_of_segments();
  out.frames.reserve(frames_.size());
  for (int i = 0; i < frames(); ++i) {
    const FrameRecord& f = record_of(i);
    PosedFrame& frame = out.frames.emplace_back();
    frame.timestamp = frames_[i].timestamp;
    frame.image_name = frames_[i].name;
    frame.reason = f.reason;
    if (f.segment < 0) continue;
    frame.segment = number_of[f.segment];
    frame.place_held = f.place_held;
    frame.world_from_rig = present_pose(f, maps[f.segment]).inverse();
    frame.covariance = covariance_of(f, maps[f.segment]);
  }
  for (int s = 0; s < static_cast<int>(maps.size()); ++s) {
    if (number_of[s] < 0) continue;
    out.segments.push_back(summary_of(s, maps[s].scale_sigma));
    out.starts.push_back(segments_[s].start);
  }
  append_maps(rig_, std::move(maps), number_of, &out);
  return out;
}

// In the result: of the segments that have frames. Others became part of one of these, or were known before
// and not seen.
std::vector<int> Odometry::numbers_of_segments() const {
  std::vector<int> number_of(segments_.size(), -1);
  for (const FrameRecord& f : frames_) {
    if (f.segment >= 0) number_of[f.segment] = 0;
  }
  int next = 0;
  for (int& number : number_of) {
    if (number == 0) number = next++;
  }
  return number_of;
}

Segment Odometry::summary_of(int number, double scale_sigma) const {
  Segment segment{-1, -1, segments_[number].end_reason, scale_sigma < kMetricSigma, {}};
  if (std::isfinite(scale_sigma)) segment.scale_sigma = scale_sigma;
  for (int i = 0; i < frames(); ++i) {
    if (record_of(i).segment != number) continue;
    if (segment.first < 0) segment.first = i;
    segment.last = i;
  }
  return segment;
}

}  // namespace raysfm
