// Coverage-guided damage to BAL files; a short deterministic relative runs with the tests
// (reconstruction_fuzz_test.cpp). Built by clang with -DRAYSFM_BUILD_FUZZERS=ON
// -DRAYSFM_SANITIZE=fuzzer-no-link,address.

#include <cstddef>
#include <cstdint>
#include <string_view>

#include "raysfm/colmap_bal/bal_file.h"
#include "raysfm/files/bzip2.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  if (raysfm::is_bzip2(bytes)) {
    (void)raysfm::decompress_bzip2(bytes, 1 << 20);
    return 0;
  }
  const raysfm::Result<raysfm::BalFile> file = raysfm::parse_bal(bytes, "file");
  if (file && !raysfm::parse_bal(raysfm::format_bal(*file), "file")) __builtin_trap();
  return 0;
}
