#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <vector>

namespace raysfm {

// The clock of all timings.
using Clock = std::chrono::steady_clock;

inline double milliseconds_since(Clock::time_point start) {
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

// Durations of one stage of the pipeline.
struct StageTiming {
  double total_ms = 0;
  double max_ms = 0;
  int64_t count = 0;
  std::vector<float> samples_ms;

  void add(double ms) {
    total_ms += ms;
    max_ms = std::max(max_ms, ms);
    ++count;
    samples_ms.push_back(static_cast<float>(ms));
  }
  double mean_ms() const { return count > 0 ? total_ms / static_cast<double>(count) : 0.0; }
  double median_ms() const {
    if (samples_ms.empty()) return 0.0;
    std::vector<float> sorted = samples_ms;
    const auto middle = sorted.begin() + static_cast<ptrdiff_t>(sorted.size() / 2);
    std::nth_element(sorted.begin(), middle, sorted.end());
    return *middle;
  }
};

// Adds the time from its construction to its destruction to a stage.
class ScopedTimer {
 public:
  explicit ScopedTimer(StageTiming& stage) : stage_(stage), start_(Clock::now()) {}
  ~ScopedTimer() { stage_.add(milliseconds_since(start_)); }
  ScopedTimer(const ScopedTimer&) = delete;
  ScopedTimer& operator=(const ScopedTimer&) = delete;

 private:
  StageTiming& stage_;
  Clock::time_point start_;
};

}  // namespace raysfm
