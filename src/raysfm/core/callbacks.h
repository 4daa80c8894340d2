#pragma once

#include <atomic>
#include <functional>
#include <utility>

#include "raysfm/core/events.h"
#include "raysfm/core/result.h"

namespace raysfm {

// What the caller of a long piece of work hears of it, and how it ends the work early; any may be left out.
// `Progress`: what its progress is told in.
template <typename... Progress>
struct Callbacks {
  EventSink event;
  // Called once, when everything given has been found good and before the work begins; an error ends the run.
  std::function<Result<void>()> ready;
  std::function<void(Progress...)> progress;  // one call at a time
  const std::atomic<bool>* stop = nullptr;    // set it to end early with what there is

  bool stopped() const { return stop && stop->load(); }

  // The same for work whose parts each call ready() before they begin: the caller hears the first call.
  Callbacks ready_once() const {
    Callbacks once = *this;
    once.ready = [first = ready, is_ready = false]() mutable -> Result<void> {
      if (std::exchange(is_ready, true) || !first) return {};
      return first();
    };
    return once;
  }
};

}  // namespace raysfm
