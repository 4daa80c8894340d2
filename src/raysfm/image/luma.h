#pragma once

#include <cstdint>

namespace raysfm {

// Luma of video in 8 bits, of which black is 16 and white 235 (ITU-R BT.601): as grey levels of 0 to 255,
// rounded; what is beyond is cut off. `in` and `out`: `count` bytes, not overlapping.
void stretch_luma(const uint8_t* in, int count, uint8_t* out);

// Level `value` of which `low` becomes 0 and `high` > `low` 255, rounded; what is beyond is cut off.
uint8_t stretched_level(int64_t value, int64_t low, int64_t high);

}  // namespace raysfm
