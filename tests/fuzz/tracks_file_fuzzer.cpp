// Coverage-guided damage to point tracks and to known structure; a short deterministic relative runs with the
// tests (tracks_fuzz_test.cpp). Built by clang with -DRAYSFM_BUILD_FUZZERS=ON
// -DRAYSFM_SANITIZE=fuzzer-no-link,address. The first byte chooses the format.

#include "memory_file.h"
#include "raysfm/results/tracks_file.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  if (size < 1) return 0;
  const raysfm::fuzz::MemoryFile file(data + 1, size - 1);
  if (data[0] % 2 == 0) {
    const raysfm::Result<raysfm::TracksFile> tracks = raysfm::read_tracks_file(file.path());
    if (tracks && tracks->image.size() != tracks->pixel.size()) __builtin_trap();
  } else {
    const raysfm::Result<raysfm::StructureFile> structure = raysfm::read_structure_file(file.path());
    if (structure && structure->points.size() != structure->positions.size()) __builtin_trap();
  }
  return 0;
}
