#include "raysfm/frames/png_pixels.h"

#include <libdeflate.h>

#include <array>
#include <bit>
#include <cstring>
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

// Values of a pixel side by side, each with room for sums of three.
using Lanes = int16_t __attribute__((vector_size(16)));
using ByteLanes = uint8_t __attribute__((vector_size(8)));

template <typename Whole>
uint64_t read(const uint8_t* bytes) {
  Whole value;
  std::memcpy(&value, bytes, sizeof(Whole));
  return value;
}

// In one or two pieces that registers hold: a copy of three bytes would go through memory, which takes longer
// than all else that is done to a pixel.
template <int kBytes>
Lanes load(const uint8_t* pixel) {
  uint64_t bytes = 0;
  if constexpr (kBytes == 2) bytes = read<uint16_t>(pixel);
  if constexpr (kBytes == 3) bytes = read<uint16_t>(pixel) | read<uint8_t>(pixel + 2) << 16;
  if constexpr (kBytes == 4) bytes = read<uint32_t>(pixel);
  if constexpr (kBytes == 6) bytes = read<uint32_t>(pixel) | read<uint16_t>(pixel + 4) << 32;
  if constexpr (kBytes == 8) bytes = read<uint64_t>(pixel);
  return __builtin_convertvector(std::bit_cast<ByteLanes>(bytes), Lanes);
}

template <int kBytes>
void store(const Lanes& values, uint8_t* pixel) {
  constexpr int kFirst = std::bit_floor(static_cast<unsigned>(kBytes));
  const auto bytes = std::bit_cast<uint64_t>(__builtin_convertvector(values, ByteLanes));
  std::memcpy(pixel, &bytes, kFirst);
  if constexpr (kBytes > kFirst) {
    const uint64_t rest = bytes >> 8 * kFirst;
    std::memcpy(pixel + kFirst, &rest, kBytes - kFirst);
  }
}

// Of left, above and above left the one nearest to left + above - above left (PNG 9.4): of left and above the
// lower one where that sum is nearer to it than to above left, the higher one likewise.
constexpr auto paeth = [](const auto& left, const auto& above, const auto& above_left) {
  const auto low = left < above ? left : above, high = left < above ? above : left;
  const auto bound = 3 * above_left - left - above;
  const auto low_or_corner = high <= bound ? low : above_left;
  return bound <= low ? high : low_or_corner;
};

// What a filter took away is added again, pixel by pixel: each depends on the one to its left. `in` may be
// `out`; `above` is the row above, unfiltered.
template <int kBytes, typename Predict>
void add_predicted(const uint8_t* in, const uint8_t* above, size_t size, uint8_t* out,
                   const Predict& predicted) {
  if constexpr (kBytes == 1) {
    int left = 0, above_left = 0;
    for (size_t i = 0; i < size; ++i) {
      const int up = above[i];
      out[i] = static_cast<uint8_t>(in[i] + predicted(left, up, above_left));
      left = out[i], above_left = up;
    }
  } else {
    Lanes left = {}, above_left = {};
    for (size_t i = 0; i < size; i += kBytes) {
      const Lanes up = load<kBytes>(above + i);
      left = (load<kBytes>(in + i) + predicted(left, up, above_left)) & 255;
      store<kBytes>(left, out + i);
      above_left = up;
    }
  }
}

template <int kBytes>
bool unfilter(int filter, const uint8_t* in, const uint8_t* above, size_t size, uint8_t* out) {
  const auto add = [&](const auto& predicted) {
    add_predicted<kBytes>(in, above, size, out, predicted);
    return true;
  };
  switch (filter) {
    case 0:
      std::memmove(out, in, size);
      return true;
    case 1:
      return add([](const auto& left, const auto&, const auto&) { return left; });
    case 2:
      for (size_t i = 0; i < size; ++i) out[i] = static_cast<uint8_t>(in[i] + above[i]);
      return true;
    case 3:
      return add([](const auto& left, const auto& up, const auto&) { return (left + up) >> 1; });
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
