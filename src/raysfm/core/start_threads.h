#pragma once

#include <system_error>
#include <thread>
#include <vector>

namespace raysfm {

// Appends up to `count` threads that run `work`. Fewer where the system has no more to give: since their
// number never changes a result, that is no failure.
template <typename Work>
void start_threads(int count, Work work, std::vector<std::jthread>* threads) {
  try {
    for (int i = 0; i < count; ++i) threads->emplace_back(work);
  } catch (const std::system_error&) {  // a limit of processes or of memory
  }
}

}  // namespace raysfm
