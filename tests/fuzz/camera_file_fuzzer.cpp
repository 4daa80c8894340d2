// Coverage-guided damage to camera files; a short deterministic relative runs with the tests
// (camera_fuzz_test.cpp). Built by clang with -DRAYSFM_BUILD_FUZZERS=ON
// -DRAYSFM_SANITIZE=fuzzer-no-link,address.

#include <cstddef>
#include <cstdint>
#include <string_view>

#include "raysfm/camera_files/camera_file.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const raysfm::Result<raysfm::Rig> rig =
      raysfm::parse_camera_file({reinterpret_cast<const char*>(data), size}, "file");
  if (rig && !raysfm::parse_camera_file(raysfm::format_camera_file(*rig), "file")) {
    for (const raysfm::Camera& camera : rig->cameras) {
      if (camera.width == 0)
        return 0;  // its size is to come from the images; the project's format demands it
    }
    __builtin_trap();
  }
  return 0;
}
