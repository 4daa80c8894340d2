#include "raysfm/api/adjust_model.h"

#include <algorithm>

namespace raysfm {

AdjustSelection::AdjustSelection(std::span<const SeenPoint> seen, const std::vector<int>& image_order,
                                 int point_count) {
  // Seeing a point twice does not place it.
  constexpr int kUnseen = -1, kByTwo = -2;
  std::vector<int> seen_by(point_count, kUnseen);
  for (const SeenPoint& s : seen) {
    int& by = seen_by[s.point];
    if (by == kUnseen) {
      by = s.image;
    } else if (by != s.image) {
      by = kByTwo;
    }
  }
  point_number.assign(point_count, -1);
  for (int i = 0; i < point_count; ++i) {
    if (seen_by[i] != kByTwo) continue;
    point_number[i] = static_cast<int>(points.size());
    points.push_back(i);
  }
  image_number.assign(image_order.size(), -1);
  std::vector<bool> sees(image_order.size(), false);
  for (const SeenPoint& s : seen) {
    if (point_number[s.point] >= 0) sees[s.image] = true;
  }
  for (const int i : image_order) {
    if (!sees[i]) continue;
    image_number[i] = static_cast<int>(images.size());
    images.push_back(i);
  }
}

bool keeps_start(AdjustOutcome* outcome) {
  BundleSummary& summary = outcome->summary;
  outcome->kept_start = !(summary.final_cost <= summary.initial_cost);
  if (!outcome->kept_start) return false;
  summary.final_cost = summary.initial_cost;
  outcome->final_rms_px = outcome->initial_rms_px;
  if (summary.termination != Termination::kInterrupted) summary.termination = Termination::kNoProgress;
  return true;
}

}  // namespace raysfm
