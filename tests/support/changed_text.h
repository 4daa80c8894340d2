#pragma once

#include <gtest/gtest.h>

#include <string>

namespace raysfm::testing_support {

// Replaces `what`, which must be there.
inline std::string with(std::string text, const std::string& what, const std::string& by) {
  const size_t at = text.find(what);
  EXPECT_NE(at, std::string::npos) << what;
  return text.replace(at, what.size(), by);
}

}  // namespace raysfm::testing_support
