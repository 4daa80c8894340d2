#pragma once

#include <atomic>
#include <functional>

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
};

}  // namespace raysfm
