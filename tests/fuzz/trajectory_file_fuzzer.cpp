// Coverage-guided damage to trajectories; a short deterministic relative runs with the tests
// (folder_fuzz_test.cpp). Built by clang with -DRAYSFM_BUILD_FUZZERS=ON
// -DRAYSFM_SANITIZE=fuzzer-no-link,address.

#include "memory_file.h"
#include "raysfm/results/trajectory_file.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const raysfm::fuzz::MemoryFile file(data, size);
  const raysfm::Result<raysfm::Trajectory> trajectory = raysfm::read_trajectory(file.path());
  if (!trajectory) return 0;
  for (int i = 1; i < trajectory->size(); ++i) {
    if (!(trajectory->timestamps[i - 1] < trajectory->timestamps[i])) __builtin_trap();
  }
  return 0;
}
