#pragma once

#include <hwy/highway.h>
#include <hwy/targets.h>

#include <bit>
#include <cstdint>

namespace raysfm::testing_support {

// Calls f(name) once for each instruction set that this processor has and the code was compiled for, with all
// run-time dispatch bound to it.
template <typename F>
void for_each_instruction_set(F f) {
  const int64_t supported = hwy::SupportedTargets();
  for (int64_t left = supported; left != 0; left &= left - 1) {
    const int64_t target = left & ~(left - 1);
    // Highway numbers the targets from the best to the plainest, which must remain as the last resort.
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(target);
    f(hwy::TargetName(target));
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}

}  // namespace raysfm::testing_support
