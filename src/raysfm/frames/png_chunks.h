#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace raysfm {

// The PNG file `bytes` with those chunks alone that its pixels are made of (IHDR, PLTE, tRNS, IDAT, IEND; PNG
// specification, second edition, section 5). Nothing where it is cut short, has no pixels or a checksum is
// wrong. libpng prints what it thinks of the other chunks, such as colour profiles, and of damage; what this
// returns gives it little occasion.
std::optional<std::string> pixel_chunks_of_png(std::string_view bytes);

// The number that four bytes begin with.
uint32_t big_endian(std::string_view bytes);

}  // namespace raysfm
