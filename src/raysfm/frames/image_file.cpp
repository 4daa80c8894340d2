#include "raysfm/frames/image_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <fstream>
#include <new>
#include <optional>
#include <string>
#include <string_view>

#include "raysfm/files/text_file.h"
#include "raysfm/frames/jpeg_pixels.h"
#include "raysfm/frames/other_image.h"
#include "raysfm/frames/png_chunks.h"
#include "raysfm/frames/png_pixels.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;
using namespace std::string_view_literals;

constexpr uintmax_t kMaxFileBytes = 512u << 20;
constexpr std::string_view kPngBegin = "\x89PNG\r\n\x1a\n", kJpegBegin = "\xff\xd8\xff";

bool begins_like_image(std::string_view head) {
  const bool pnm = head.size() > 2 && head[0] == 'P' && head[1] >= '1' && head[1] <= '6' &&
                   std::isspace(static_cast<unsigned char>(head[2]));
  const bool webp = head.starts_with("RIFF") && head.substr(0, 12).ends_with("WEBP");
  return pnm || webp || head.starts_with(kPngBegin) || head.starts_with(kJpegBegin) ||
         head.starts_with("II*\0"sv) || head.starts_with("MM\0*"sv) ||
         (head.starts_with("BM") && head.size() > 14);
}

// Whether the mark at the end of a JPEG file is missing. libjpeg fills what is missing with grey.
bool cut_short(std::string_view jpeg) {
  constexpr size_t kTail = 65536;  // some cameras append data of their own
  const std::string_view tail = jpeg.substr(jpeg.size() - std::min(jpeg.size(), kTail));
  return tail.find("\xff\xd9") == std::string_view::npos;
}

Result<DecodedImage> decode(const std::string& file) {
  const Error damaged = bad_input("the image is damaged and cannot be decoded");
  if (file.starts_with(kJpegBegin)) {
    if (cut_short(file)) return damaged;
    return decode_jpeg(file);
  }
  if (!file.starts_with(kPngBegin)) return decode_other(file);
  const std::optional<std::string> chunks = pixel_chunks_of_png(file);
  if (!chunks) return damaged;
  return is_plain_png(*chunks) ? decode_png(*chunks) : decode_other(*chunks);
}

}  // namespace

bool is_image_file(const fs::path& path) {
  std::array<char, 16> head{};
  std::ifstream file(path, std::ios::binary);
  file.read(head.data(), head.size());
  return begins_like_image({head.data(), static_cast<size_t>(file.gcount())});
}

Result<DecodedImage> read_image(const fs::path& path) try {
  const Result<std::string> bytes = read_text_file(path, kMaxFileBytes);
  if (!bytes) return bytes.error();
  if (!begins_like_image(*bytes)) {
    return bad_input(fmt::format("{}: no image; allowed: PNG, JPEG, BMP, TIFF, PNM, WebP", path.string()));
  }
  Result<DecodedImage> image = decode(*bytes);
  if (!image) return Error{image.error().kind, fmt::format("{}: {}", path.string(), image.error().message)};
  return image;
} catch (const std::bad_alloc&) {
  return internal_error(fmt::format("{}: not enough memory to decode it", path.string()));
}

Result<GrayImage> read_mask(const fs::path& path, int width, int height) {
  Result<DecodedImage> image = read_image(path);
  if (!image) return image.error();
  GrayImage mask = std::move(image->gray);
  if (mask.width() != width || mask.height() != height) {
    return bad_input(fmt::format("{}: the mask is {} x {}; allowed: the camera's {} x {}", path.string(),
                                 mask.width(), mask.height(), width, height));
  }
  int brightest = 0;
  for (int y = 0; y < height; ++y) {
    brightest = std::max<int>(brightest, *std::max_element(mask.row(y), mask.row(y) + width));
  }
  if (brightest > 0 && brightest <= 127) {
    return bad_input(
        fmt::format("{}: the brightest pixel of the mask is {}; allowed: 255 where a pixel sees the scene",
                    path.string(), brightest));
  }
  for (int y = 0; y < height; ++y) {
    for (uint8_t* p = mask.row(y); p != mask.row(y) + width; ++p) *p = *p > 127 ? 255 : 0;
  }
  return mask;
}

}  // namespace raysfm
