#include "raysfm/frames/png_pixels.h"

#include <libdeflate.h>

#include <array>
#include <cstdlib>
#include <memory>
#include <new>
#include <string>
#include <utility>
#include <vector>

#include "raysfm/frames/png_chunks.h"

namespace raysfm {
namespace {

constexpr size_t kHeaderEnd = 33;  // signature and IHDR
// Deflate packs 258 bytes into two bits at best.
constexpr size_t kMaxRatio = 1032;

struct Header {
  int64_t width, height;
  int depth;     // bits per value: 8 or 16
  int channels;  // 1 grey, 2 grey and alpha, 3 colours, 4 colours and alpha

  int pixel_bytes() const { return channels * depth / 8; }
  size_t row_bytes() const { return static_cast<size_t>(width) * pixel_bytes(); }
};

Header header_of(std::string_view bytes) {
  constexpr std::array kChannels = {1, 0, 3, 0, 2, 0, 4};  // by type of colour
  return {big_endian(bytes.substr(16)), big_endian(bytes.substr(20)), bytes[24], kChannels[bytes[25]]};
}

Error damaged() {
  return bad_input("the image is damaged and cannot be decoded");
}

// The packed rows, in one piece.
std::string pixel_data(std::string_view bytes) {
  std::string data;
  data.reserve(bytes.size());
  for (bytes.remove_prefix(kHeaderEnd); !bytes.empty();) {
    const size_t size = big_endian(bytes);
    if (bytes.substr(4, 4) == "IDAT") data += bytes.substr(8, size);
    bytes.remove_prefix(size + 12);
  }
  return data;
}

// Rows as filtered, each behind the byte that names its filter.
using Rows = std::unique_ptr<uint8_t[]>;

bool unpack(const std::string& packed, size_t size, uint8_t* rows) {
  thread_local const std::unique_ptr<libdeflate_decompressor, decltype(&libdeflate_free_decompressor)>
      inflater(libdeflate_alloc_decompressor(), libdeflate_free_decompressor);
  if (!inflater) throw std::bad_alloc();
  return libdeflate_zlib_decompress(inflater.get(), packed.data(), packed.size(), rows, size, nullptr) ==
         LIBDEFLATE_SUCCESS;
}

// Of left, above and above left the one nearest to left + above - above left (PNG 9.4).
inline int paeth(int left, int above, int above_left) {
  const int to_left = std::abs(above - above_left), to_above = std::abs(left - above_left);
  const int to_above_left = std::abs(left + above - 2 * above_left);
  const int nearer = to_above <= to_above_left ? above : above_left;
  return to_left <= to_above && to_left <= to_above_left ? left : nearer;
}

// What a filter took away is added again. `in` may be `out`; `above` is the row above, unfiltered. kStep is
// the distance of neighbours in bytes.
template <int kStep>
bool unfilter(int filter, const uint8_t* in, const uint8_t* above, size_t size, uint8_t* out) {
  const auto add = [&](auto predicted) {
    for (size_t i = 0; i < kStep; ++i) out[i] = static_cast<uint8_t>(in[i] + predicted(0, above[i], 0));
    for (size_t i = kStep; i < size; ++i) {
      out[i] = static_cast<uint8_t>(in[i] + predicted(out[i - kStep], above[i], above[i - kStep]));
    }
    return true;
  };
  switch (filter) {
    case 0:
      return add([](int, int, int) { return 0; });
    case 1:
      return add([](int left, int, int) { return left; });
    case 2:
      return add([](int, int up, int) { return up; });
    case 3:
      return add([](int left, int up, int) { return (left + up) / 2; });
    case 4:
      return add(paeth);
    default:
      return false;
  }
}

auto unfilter_for(int pixel_bytes) {
  switch (pixel_bytes) {
    case 1:
      return unfilter<1>;
    case 2:
      return unfilter<2>;
    case 3:
      return unfilter<3>;
    case 4:
      return unfilter<4>;
    case 6:
      return unfilter<6>;
    default:
      return unfilter<8>;
  }
}

// All rows unfiltered; row_of(y) is where row y goes.
template <typename RowOf>
bool unfilter_rows(const Header& header, const uint8_t* rows, const RowOf& row_of) {
  const auto unfilter_row = unfilter_for(header.pixel_bytes());
  const size_t size = header.row_bytes();
  const std::vector<uint8_t> nothing(size, 0);
  const uint8_t* above = nothing.data();
  for (int y = 0; y < header.height; ++y) {
    const uint8_t* in = rows + y * (size + 1);
    uint8_t* out = row_of(y);
    if (!unfilter_row(in[0], in + 1, above, size, out)) return false;
    above = out;
  }
  return true;
}

// Rows of big-endian 16 bits to 8.
void narrow(const uint8_t* in, int count, uint8_t* out) {
  for (int i = 0; i < count; ++i) {
    out[i] = static_cast<uint8_t>(((in[2 * i] << 8 | in[2 * i + 1]) + 128) / 257);
  }
}

}  // namespace

bool is_plain_png(std::string_view bytes) {
  if (bytes.size() < kHeaderEnd || big_endian(bytes.substr(8)) != 13) return false;
  const int depth = bytes[24], colour = bytes[25], interlaced = bytes[28];
  return (depth == 8 || depth == 16) && (colour == 0 || colour == 2 || colour == 4 || colour == 6) &&
         interlaced == 0;
}

Result<DecodedImage> decode_png(std::string_view bytes) {
  const Header header = header_of(bytes);
  if (auto fits = check_image_size(header.width, header.height); !fits) return fits.error();
  const std::string packed = pixel_data(bytes);
  const size_t size = (header.row_bytes() + 1) * header.height;
  if (size / kMaxRatio > packed.size()) return damaged();
  const Rows rows = std::make_unique_for_overwrite<uint8_t[]>(size);
  if (!unpack(packed, size, rows.get())) return damaged();

  const int width = static_cast<int>(header.width), height = static_cast<int>(header.height);
  const int values = width * header.channels;
  Image<uint8_t> pixels(values, height);
  const auto in_place = [&](int y) { return rows.get() + y * (header.row_bytes() + 1) + 1; };
  const bool ok = header.depth == 8 ? unfilter_rows(header, rows.get(), [&](int y) { return pixels.row(y); })
                                    : unfilter_rows(header, rows.get(), in_place);
  if (!ok) return damaged();
  for (int y = 0; header.depth == 16 && y < height; ++y) narrow(in_place(y), values, pixels.row(y));

  DecodedImage image;
  if (header.channels == 1) {
    image.gray = std::move(pixels);
  } else if (header.channels == 2) {
    image.gray = GrayImage(width, height);
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) image.gray.row(y)[x] = pixels.row(y)[2 * x];
    }
  } else {
    image.colors.values_per_pixel = header.channels;
    image.colors.rgb = std::move(pixels);
    image.gray = gray_of(image.colors);
  }
  return image;
}

}  // namespace raysfm
