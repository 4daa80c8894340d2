#include "raysfm/image/luma.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "support/instruction_sets.h"

namespace raysfm {
namespace {

using testing_support::for_each_instruction_set;

TEST(Luma, EveryLevelIsThatOfTheDefinition) {
  std::vector<uint8_t> in(256);
  std::iota(in.begin(), in.end(), uint8_t{0});
  for_each_instruction_set([&](const char* name) {
    // Also shorter than a vector, and where the last one overlaps.
    for (const int count : {1, 7, 33, 255, 256}) {
      std::vector<uint8_t> out(count + 1, 99);
      const uint8_t* last = in.data() + 256 - count;
      stretch_luma(last, count, out.data());
      for (int i = 0; i < count; ++i) {
        const double level = std::clamp((last[i] - 16) * 255. / 219, 0., 255.);
        ASSERT_EQ(out[i], std::lround(level)) << name << ' ' << static_cast<int>(last[i]);
      }
      EXPECT_EQ(out[count], 99) << name;
    }
  });
}

TEST(Luma, MoreBitsAreRoundedTo8) {
  EXPECT_EQ(stretched_level(64, 64, 940), 0);
  EXPECT_EQ(stretched_level(940, 64, 940), 255);
  EXPECT_EQ(stretched_level(502, 64, 940), 128);  // 127.5
  EXPECT_EQ(stretched_level(0, 64, 940), 0);
  EXPECT_EQ(stretched_level(1023, 64, 940), 255);
}

}  // namespace
}  // namespace raysfm
