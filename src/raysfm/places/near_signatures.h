#pragma once

#include <cstddef>
#include <cstdint>

namespace raysfm {

// Writes to `found`, which has room for `count`, the indices of the signatures that differ from one in no
// more than `most` bits, ascending, and returns how many these are; the same on every instruction set.
size_t find_near_signatures(uint64_t signature, const uint64_t* signatures, size_t count, int most,
                            uint32_t* found);

}  // namespace raysfm
