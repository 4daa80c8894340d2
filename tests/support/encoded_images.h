#pragma once

#include <libdeflate.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

// This comes after <cstdio>, which it needs.
#include <jpeglib.h>

namespace raysfm::testing_support {

// A PNG file made from values by the specification. Values have 8 bits, or 16 in big-endian order.
struct PngRecipe {
  int width = 0, height = 0, depth = 8;
  int color_type = 0;                      // 0 grey, 2 RGB, 3 palette, 4 grey and alpha, 6 RGB and alpha
  std::vector<uint8_t> bytes = {};         // rows without filters
  std::vector<int> filters = {0};          // of the rows, over and over
  std::string palette = {};                // of PLTE
  size_t idat_bytes = SIZE_MAX;            // at most, of one chunk
  void (*damage)(std::string*) = nullptr;  // done to the rows before they are packed
};

inline std::string big_endian_bytes(uint32_t value) {
  std::string bytes;
  for (int shift = 24; shift >= 0; shift -= 8) bytes += static_cast<char>(value >> shift);
  return bytes;
}

inline std::string png_chunk(const std::string& type, const std::string& data) {
  const std::string content = type + data;
  return big_endian_bytes(static_cast<uint32_t>(data.size())) + content +
         big_endian_bytes(libdeflate_crc32(0, content.data(), content.size()));
}

inline std::string zlib_packed(const std::string& bytes) {
  libdeflate_compressor* compressor = libdeflate_alloc_compressor(1);
  std::string packed(libdeflate_zlib_compress_bound(compressor, bytes.size()), '\0');
  packed.resize(
      libdeflate_zlib_compress(compressor, bytes.data(), bytes.size(), packed.data(), packed.size()));
  libdeflate_free_compressor(compressor);
  return packed;
}

// Rows filtered as section 9 of the specification says.
inline std::string filtered_rows(const PngRecipe& recipe) {
  const int channels[] = {1, 0, 3, 1, 2, 0, 4};
  const int step = channels[recipe.color_type] * recipe.depth / 8, row = recipe.width * step;
  const auto at = [&](int y, int i) { return y < 0 || i < 0 ? 0 : int(recipe.bytes[size_t(y) * row + i]); };
  std::string out;
  for (int y = 0; y < recipe.height; ++y) {
    const int filter = recipe.filters[y % recipe.filters.size()];
    out += static_cast<char>(filter);
    for (int i = 0; i < row; ++i) {
      const int a = at(y, i - step), b = at(y - 1, i), c = i < step ? 0 : at(y - 1, i - step);
      const int p = a + b - c, pa = std::abs(p - a), pb = std::abs(p - b), pc = std::abs(p - c);
      const int paeth = pa <= pb && pa <= pc ? a : pb <= pc ? b : c;
      const int predicted[] = {0, a, b, (a + b) / 2, paeth};
      out += static_cast<char>(at(y, i) - (filter <= 4 ? predicted[filter] : 0));
    }
  }
  return out;
}

inline std::string png_file(const PngRecipe& recipe) {
  std::string rows = filtered_rows(recipe);
  if (recipe.damage) recipe.damage(&rows);
  const std::string packed = zlib_packed(rows);
  std::string file = "\x89PNG\r\n\x1a\n";
  file += png_chunk("IHDR", big_endian_bytes(uint32_t(recipe.width)) +
                                big_endian_bytes(uint32_t(recipe.height)) + static_cast<char>(recipe.depth) +
                                static_cast<char>(recipe.color_type) + std::string(3, '\0'));
  if (!recipe.palette.empty()) file += png_chunk("PLTE", recipe.palette);
  for (size_t i = 0; i < packed.size(); i += std::min(recipe.idat_bytes, packed.size() - i)) {
    file += png_chunk("IDAT", packed.substr(i, recipe.idat_bytes));
  }
  return file + png_chunk("IEND", "");
}

// A JPEG file by libjpeg.
struct JpegRecipe {
  int width = 0, height = 0;
  J_COLOR_SPACE given = JCS_RGB, stored = JCS_YCbCr;
  std::vector<uint8_t> values = {};  // as many for each pixel as `given` has
  int luma_h = 1, luma_v = 1;        // sampling factors; those of the other components are 1
  bool progressive = false;
  int quality = 90;
};

inline std::string jpeg_file(const JpegRecipe& recipe) {
  jpeg_compress_struct info{};
  jpeg_error_mgr errors{};
  info.err = jpeg_std_error(&errors);
  jpeg_create_compress(&info);
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  jpeg_mem_dest(&info, &bytes, &size);
  info.image_width = static_cast<JDIMENSION>(recipe.width);
  info.image_height = static_cast<JDIMENSION>(recipe.height);
  info.input_components = recipe.given == JCS_GRAYSCALE ? 1 : recipe.given == JCS_CMYK ? 4 : 3;
  info.in_color_space = recipe.given;
  jpeg_set_defaults(&info);
  jpeg_set_colorspace(&info, recipe.stored);
  jpeg_set_quality(&info, recipe.quality, TRUE);
  info.comp_info[0].h_samp_factor = recipe.luma_h;
  info.comp_info[0].v_samp_factor = recipe.luma_v;
  for (int c = 1; c < info.num_components; ++c) {
    info.comp_info[c].h_samp_factor = info.comp_info[c].v_samp_factor = 1;
  }
  if (recipe.progressive) jpeg_simple_progression(&info);
  jpeg_start_compress(&info, TRUE);
  while (info.next_scanline < info.image_height) {
    JSAMPROW row = const_cast<uint8_t*>(recipe.values.data()) +
                   size_t{info.next_scanline} * recipe.width * info.input_components;
    jpeg_write_scanlines(&info, &row, 1);
  }
  jpeg_finish_compress(&info);
  jpeg_destroy_compress(&info);
  const std::string file(reinterpret_cast<char*>(bytes), size);
  std::free(bytes);
  return file;
}

}  // namespace raysfm::testing_support
