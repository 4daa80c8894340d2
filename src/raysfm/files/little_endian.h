#pragma once

#include <bit>
#include <cstring>
#include <string>
#include <type_traits>

namespace raysfm {

// Appends the bytes of a number to `bytes`, least significant first, as PLY and COLMAP have them.
template <typename T>
void append_little_endian(std::string& bytes, T value) {
  static_assert(std::is_arithmetic_v<T>);
  static_assert(std::endian::native == std::endian::little, "swap the bytes here");
  char buffer[sizeof(T)];
  std::memcpy(buffer, &value, sizeof(T));
  bytes.append(buffer, sizeof(T));
}

}  // namespace raysfm
