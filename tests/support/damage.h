#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <span>
#include <string>

#include "raysfm/core/random.h"
#include "raysfm/core/result.h"

namespace raysfm::testing_support {

// `text` with one to three changes: a byte, a cut, the end lost, a copy, or one of `pieces` that have a
// meaning in its format put in or written over it.
inline std::string damaged(std::string text, std::span<const std::string> pieces, Rng& random) {
  for (uint32_t change = 1 + random.index(3); change > 0 && !text.empty(); --change) {
    const size_t size = text.size(), at = random.index(static_cast<uint32_t>(size));
    const size_t length = std::min<size_t>(1 + random.index(40), size - at);
    const std::string& piece = pieces[random.index(static_cast<uint32_t>(pieces.size()))];
    switch (random.index(6)) {
      case 0:
        text[at] = static_cast<char>(random.index(256));
        break;
      case 1:
        text.erase(at, length);
        break;
      case 2:
        text.resize(at);
        break;
      case 3:
        text.insert(random.index(static_cast<uint32_t>(size)), text.substr(at, length));
        break;
      case 4:
        text.insert(at, piece);
        break;
      default:
        text.replace(at, piece.size(), piece);
        break;
    }
  }
  return text;
}

// What is wrong with an input is said in one line.
inline void expect_line(const Error& error) {
  ASSERT_EQ(error.kind, ErrorKind::kBadInput) << error.message;
  ASSERT_FALSE(error.message.empty());
  ASSERT_EQ(error.message.find('\n'), std::string::npos) << error.message;
}

}  // namespace raysfm::testing_support
