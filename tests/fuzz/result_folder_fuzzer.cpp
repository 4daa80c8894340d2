// Coverage-guided damage to the report and the other texts of a result; a short deterministic relative runs
// with the tests (folder_fuzz_test.cpp). Built by clang with -DRAYSFM_BUILD_FUZZERS=ON
// -DRAYSFM_SANITIZE=fuzzer-no-link,address. The first two bytes, in units of 1/256 of the rest, tell where
// report.json and trajectory.txt end; what follows is keyframes.txt.

#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>

#include "raysfm/results/reconstruction_folder.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  if (size < 2) return 0;
  static const std::filesystem::path folder =
      std::filesystem::temp_directory_path() / ("raysfm_fuzz_" + std::to_string(getpid()));
  std::filesystem::create_directories(folder);
  const char* bytes = reinterpret_cast<const char*>(data) + 2;
  const size_t length = size - 2;
  const size_t report = length * data[0] / 256, trajectory = (length - report) * data[1] / 256;
  const auto file = [&](const char* name, size_t first, size_t count) {
    std::ofstream(folder / name, std::ios::binary).write(bytes + first, static_cast<std::streamsize>(count));
  };
  file("report.json", 0, report);
  file("trajectory.txt", report, trajectory);
  file("keyframes.txt", report + trajectory, length - report - trajectory);
  (void)raysfm::read_reconstruction(folder);
  return 0;
}
