#pragma once

#include <string>
#include <string_view>

namespace raysfm {

// Bytes as text of RFC 4648, section 4, padded with '='.
std::string base64(std::string_view bytes);

}  // namespace raysfm
