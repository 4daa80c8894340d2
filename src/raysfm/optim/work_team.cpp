#include "raysfm/optim/work_team.h"

#include "raysfm/core/start_threads.h"

namespace raysfm {
namespace {

constexpr int kSpins = 2000;  // some microseconds: the next loop mostly follows at once

// Returns when `value` is no longer `old`.
template <typename T>
void wait_for_change(const std::atomic<T>& value, T old) {
  for (int i = 0; i < kSpins; ++i) {
    if (value.load(std::memory_order_acquire) != old) return;
  }
  value.wait(old, std::memory_order_acquire);
}

}  // namespace

WorkTeam::WorkTeam(int threads) {
  start_threads(
      threads - 1, [this] { serve(); }, &workers_);
}

WorkTeam::~WorkTeam() {
  stopping_ = true;
  loop_.fetch_add(1, std::memory_order_release);
  loop_.notify_all();
  workers_.clear();
}

void WorkTeam::run_shared(int count, Call call, const void* body) {
  call_ = call, body_ = body, count_ = count;
  next_.store(0, std::memory_order_relaxed);
  busy_.store(static_cast<int>(workers_.size()), std::memory_order_relaxed);
  loop_.fetch_add(1, std::memory_order_release);
  loop_.notify_all();
  take_part();
  for (int busy = busy_.load(std::memory_order_acquire); busy != 0;
       busy = busy_.load(std::memory_order_acquire)) {
    wait_for_change(busy_, busy);
  }
}

void WorkTeam::take_part() {
  for (int i = next_.fetch_add(1, std::memory_order_relaxed); i < count_;
       i = next_.fetch_add(1, std::memory_order_relaxed)) {
    call_(body_, i);
  }
}

void WorkTeam::serve() {
  for (uint32_t seen = 0;;) {
    wait_for_change(loop_, seen);
    // A worker is awaited before the next loop begins, so it never misses one.
    ++seen;
    if (stopping_) return;
    take_part();
    busy_.fetch_sub(1, std::memory_order_release);
    busy_.notify_one();
  }
}

}  // namespace raysfm
