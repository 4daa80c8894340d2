// Coverage-guided damage to the files of --config; a short deterministic relative runs with the tests
// (config_test.cpp). Built by clang with -DRAYSFM_BUILD_FUZZERS=ON -DRAYSFM_SANITIZE=fuzzer-no-link,address.

#include "memory_file.h"
#include "raysfm/settings/config.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const raysfm::fuzz::MemoryFile file(data, size);
  raysfm::TrackSettings settings;
  const auto record = raysfm::read_config(file.path(), raysfm::setting_fields(settings), {});
  if (!record && record.error().kind != raysfm::ErrorKind::kBadInput) __builtin_trap();
  return 0;
}
