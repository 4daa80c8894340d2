#pragma once

#include <filesystem>

namespace raysfm::testing_support {

// Real data that are not part of the project. RAYSFM_SHARED_DATA names their folder; without it the folder
// ../shared/data beside the project is used.
std::filesystem::path shared_data(const std::filesystem::path& relative);

}  // namespace raysfm::testing_support

// Skips the test, saying so, where the file or folder is missing.
#define RAYSFM_SKIP_WITHOUT_SHARED_DATA(relative)                               \
  if (!std::filesystem::exists(raysfm::testing_support::shared_data(relative))) \
  GTEST_SKIP() << "no shared data: " << (relative) << " (set RAYSFM_SHARED_DATA)"
