#include "raysfm/places/near_signatures.h"

#include <gtest/gtest.h>

#include <bit>
#include <vector>

#include "raysfm/core/random.h"
#include "support/instruction_sets.h"

namespace raysfm {
namespace {

TEST(NearSignatures, AreThoseOfTheDefinitionOnEveryInstructionSet) {
  Rng rng(4);
  int found_at_all = 0;
  for (const size_t count : {0, 1, 2, 3, 7, 8, 9, 16, 17, 100}) {
    for (const int most : {-1, 0, 1, 20, 30, 63, 64}) {
      const uint64_t asked = rng.next();
      std::vector<uint64_t> signatures(count);
      for (size_t i = 0; i < count; ++i) {
        signatures[i] = i % 3 == 0 ? asked ^ (rng.next() & rng.next() & rng.next()) : rng.next();
      }
      if (count > 3) signatures[count - 1] = asked, signatures[2] = ~asked;
      std::vector<uint32_t> expected;
      for (size_t i = 0; i < count; ++i) {
        if (std::popcount(signatures[i] ^ asked) <= most) expected.push_back(static_cast<uint32_t>(i));
      }
      found_at_all += static_cast<int>(expected.size());
      testing_support::for_each_instruction_set([&](const char* name) {
        std::vector<uint32_t> found(count);
        found.resize(find_near_signatures(asked, signatures.data(), count, most, found.data()));
        EXPECT_EQ(found, expected) << name << ", " << count << ", " << most;
      });
    }
  }
  EXPECT_GT(found_at_all, 300);
}

}  // namespace
}  // namespace raysfm
