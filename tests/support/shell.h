#pragma once

#include <cstdlib>
#include <string>

namespace raysfm::testing_support {

// Whether a command of the shell succeeds; what it prints is dropped.
inline bool run(const std::string& command) {
  return std::system((command + " >/dev/null 2>&1").c_str()) == 0;
}

}  // namespace raysfm::testing_support
