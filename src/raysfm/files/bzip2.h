#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "raysfm/core/result.h"

namespace raysfm {

// Whether the bytes begin as a bzip2 file does.
bool is_bzip2(std::string_view bytes);

// What a bzip2 file holds; several streams in one file are read one after another, as bzip2 does. Errors: bad
// input, without the file's name: damaged, cut off, followed by something else, or more than `max_bytes` of
// content, of which no more is unpacked.
Result<std::string> decompress_bzip2(std::string_view bytes, uintmax_t max_bytes);

// A bzip2 file that holds `content`.
std::string compress_bzip2(std::string_view content);

}  // namespace raysfm
