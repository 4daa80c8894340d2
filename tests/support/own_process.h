#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <string>

namespace raysfm {

// A test of what changes a process for good runs in one of its own, which says what failed.
inline void run_alone(void (*test)()) {
  EXPECT_EXIT(
      {
        test();
        std::exit(testing::Test::HasFailure() ? 1 : 0);
      },
      testing::ExitedWithCode(0), "");
}

// Whether a program may ask for pages of the large size of the system.
inline bool has_large_pages() {
  std::ifstream enabled("/sys/kernel/mm/transparent_hugepage/enabled");
  std::string modes;
  return std::getline(enabled, modes) && modes.find("[never]") == std::string::npos;
}

}  // namespace raysfm
