#include "raysfm/frames/png_chunks.h"

#include <libdeflate.h>

#include <algorithm>
#include <array>
#include <cstdint>

namespace raysfm {
namespace {

using namespace std::string_view_literals;

constexpr size_t kSignature = 8;              // bytes
constexpr size_t kChunkFrame = 12;            // bytes of a chunk beside its data: length, type, checksum
constexpr size_t kMaxData = size_t{1} << 31;  // bytes
constexpr std::array kPixelChunks = {"IHDR"sv, "PLTE"sv, "tRNS"sv, "IDAT"sv, "IEND"sv};

uint32_t checksum(std::string_view bytes) {
  return libdeflate_crc32(0, bytes.data(), bytes.size());
}

}  // namespace

uint32_t big_endian(std::string_view bytes) {
  uint32_t value = 0;
  for (const char byte : bytes.substr(0, 4)) value = value << 8 | static_cast<uint8_t>(byte);
  return value;
}

std::optional<std::string> pixel_chunks_of_png(std::string_view bytes) {
  if (bytes.size() < kSignature + kChunkFrame || bytes.substr(kSignature + 4, 4) != "IHDR")
    return std::nullopt;
  std::string kept(bytes.substr(0, kSignature));
  kept.reserve(bytes.size());
  bool has_pixels = false;
  for (bytes.remove_prefix(kSignature); bytes.size() >= kChunkFrame;) {
    const size_t data = big_endian(bytes);
    if (data >= kMaxData || data > bytes.size() - kChunkFrame) return std::nullopt;
    const std::string_view type = bytes.substr(4, 4);
    if (std::ranges::find(kPixelChunks, type) != kPixelChunks.end()) {
      if (checksum(bytes.substr(4, 4 + data)) != big_endian(bytes.substr(8 + data))) return std::nullopt;
      kept += bytes.substr(0, data + kChunkFrame);
      has_pixels |= type == "IDAT";
    }
    if (type == "IEND") return has_pixels ? std::optional(std::move(kept)) : std::nullopt;
    bytes.remove_prefix(data + kChunkFrame);
  }
  return std::nullopt;
}

}  // namespace raysfm
