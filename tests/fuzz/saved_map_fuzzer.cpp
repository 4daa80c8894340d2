// Coverage-guided damage to saved maps; a short deterministic relative runs with the tests
// (saved_map_test.cpp). Built by clang with -DRAYSFM_BUILD_FUZZERS=ON
// -DRAYSFM_SANITIZE=fuzzer-no-link,address. The corpus should begin with a map. SQLite opens no file that
// lies in memory alone.

#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>

#include "raysfm/saved_map/saved_map.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  static const std::filesystem::path path =
      std::filesystem::temp_directory_path() / ("saved_map_fuzzer." + std::to_string(getpid()));
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(data), static_cast<std::streamsize>(size));
  const raysfm::Result<raysfm::SavedMap> map = raysfm::read_saved_map(path);
  if (map ? !raysfm::check_saved_map(*map) : map.error().kind != raysfm::ErrorKind::kBadInput)
    __builtin_trap();
  return 0;
}
