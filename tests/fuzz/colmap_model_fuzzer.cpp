// Coverage-guided damage to COLMAP models; a short deterministic relative runs with the tests
// (reconstruction_fuzz_test.cpp). Built by clang with -DRAYSFM_BUILD_FUZZERS=ON
// -DRAYSFM_SANITIZE=fuzzer-no-link,address. The first byte chooses the format, and the next two, in units of
// 1/256 of the rest, where cameras and images end.

#include <cstddef>
#include <cstdint>

#include "raysfm/colmap_bal/colmap_model.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  if (size < 3) return 0;
  const char* bytes = reinterpret_cast<const char*>(data) + 3;
  const size_t length = size - 3;
  const size_t cameras = length * data[1] / 256, images = (length - cameras) * data[2] / 256;
  raysfm::ColmapFiles files{.binary = data[0] % 2 == 0, .cameras = {}, .images = {}, .points = {}};
  files.cameras.assign(bytes, cameras);
  files.images.assign(bytes + cameras, images);
  files.points.assign(bytes + cameras + images, length - cameras - images);
  const raysfm::Result<raysfm::ColmapModel> model = raysfm::parse_colmap(files, "folder");
  if (!model) return 0;
  const raysfm::ColmapFiles written = raysfm::format_colmap(*model);
  if (files.binary && (written.cameras != files.cameras || written.images != files.images ||
                       written.points != files.points)) {
    __builtin_trap();
  }
  if (!raysfm::parse_colmap(written, "folder")) __builtin_trap();
  return 0;
}
