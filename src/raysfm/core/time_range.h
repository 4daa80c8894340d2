#pragma once

#include <string>

#include "raysfm/core/result.h"

namespace raysfm {

// Part of an input, both ends of it included.
struct TimeRange {
  double from = 0;  // seconds, as the timestamps of the frames
  double to = 0;    // 0: up to the end

  bool is_all() const { return from <= 0 && to <= 0; }
  bool is_before(double timestamp) const { return timestamp < from; }
  bool is_behind(double timestamp) const { return to > 0 && timestamp > to; }
};

// Bad input for ends that are no times, or in the wrong order.
Result<void> check_range(const TimeRange& range);

// Bad input for a range in which a stream has no frame.
Error no_frames_in(const TimeRange& range, const std::string& stream);

}  // namespace raysfm
