#include "raysfm/frames/jpeg_pixels.h"

#include <algorithm>
#include <array>
#include <csetjmp>
#include <cstddef>
#include <cstdio>
#include <vector>

// These come after <cstddef> and <cstdio>, which they need.
#include <jerror.h>
#include <jpeglib.h>

namespace raysfm {
namespace {

// Huffman codes have at least a bit for each block of 64 pixels.
constexpr size_t kMostPixelsPerByte = 512;           // pixels per byte
constexpr int kMaxRows = MAX_SAMP_FACTOR * DCTSIZE;  // of one component that are decoded at once

// libjpeg leaves by a jump where it cannot go on, and prints what it only wonders about.
struct ErrorTrap {
  jpeg_error_mgr manager;  // the first member: libjpeg knows no other
  std::jmp_buf jump;
  bool damaged = false;
};

void leave(j_common_ptr info) {
  std::longjmp(reinterpret_cast<ErrorTrap*>(info->err)->jump, 1);
}

// Some cameras leave bytes between the parts of a file; libjpeg skips them without harm.
void take_note(j_common_ptr info, int level) {
  const int code = info->err->msg_code;
  if (level < 0 && (code == JWRN_HIT_MARKER || code == JWRN_HUFF_BAD_CODE || code == JWRN_JPEG_EOF ||
                    code == JWRN_MUST_RESYNC)) {
    reinterpret_cast<ErrorTrap*>(info->err)->damaged = true;
  }
}

class JpegDecoder {
 public:
  explicit JpegDecoder(std::string_view bytes) : bytes_(bytes) {
    info_.err = jpeg_std_error(&trap_.manager);
    trap_.manager.error_exit = leave;
    trap_.manager.emit_message = take_note;
    jpeg_create_decompress(&info_);
  }
  ~JpegDecoder() { jpeg_destroy_decompress(&info_); }
  JpegDecoder(const JpegDecoder&) = delete;
  JpegDecoder& operator=(const JpegDecoder&) = delete;

  Result<DecodedImage> decode() {
    if (!read_header()) return failure();
    if (auto fits = check_image_size(info_.image_width, info_.image_height); !fits) return fits.error();
    const size_t pixels = size_t{info_.image_width} * info_.image_height;
    if (!info_.arith_code && pixels / kMostPixelsPerByte > bytes_.size()) return failure();
    DecodedImage image;
    const bool decoded = stored_as_luma() ? read_planes(&image) : read_colors(&image);
    if (!decoded || trap_.damaged) return failure();
    return image;
  }

 private:
  // Steps of libjpeg: false where it left. Nothing on their stack has a destructor.
  template <typename Steps>
  bool guarded(const Steps& steps) {
    if (setjmp(trap_.jump)) return false;
    steps();
    return true;
  }

  bool read_header() {
    return guarded([this] {
      jpeg_mem_src(&info_, reinterpret_cast<const unsigned char*>(bytes_.data()), bytes_.size());
      jpeg_read_header(&info_, TRUE);
    });
  }

  Error failure() {
    if (trap_.manager.msg_code == JERR_OUT_OF_MEMORY) return internal_error("not enough memory to decode it");
    return bad_input("the image is damaged and cannot be decoded");
  }

  // Whether the components can be taken as they are: luma in full resolution, chroma alike in both.
  bool stored_as_luma() const {
    const jpeg_component_info* c = info_.comp_info;
    if (info_.jpeg_color_space == JCS_GRAYSCALE) return info_.num_components == 1;
    return info_.jpeg_color_space == JCS_YCbCr && info_.num_components == 3 &&
           c[0].h_samp_factor == info_.max_h_samp_factor && c[0].v_samp_factor == info_.max_v_samp_factor &&
           c[1].h_samp_factor == c[2].h_samp_factor && c[1].v_samp_factor == c[2].v_samp_factor &&
           c[0].h_samp_factor % c[1].h_samp_factor == 0 && c[0].v_samp_factor % c[1].v_samp_factor == 0;
  }

  bool read_planes(DecodedImage* image) {
    info_.raw_data_out = TRUE;
    if (!guarded([this] { jpeg_start_decompress(&info_); })) return false;
    std::array<Image<uint8_t>*, 3> planes = {&image->gray, &image->colors.cb, &image->colors.cr};
    for (int c = 0; c < info_.num_components; ++c) {
      const jpeg_component_info& component = info_.comp_info[c];
      // Rows of an image have room for whole blocks of 8.
      *planes[c] = Image<uint8_t>(static_cast<int>(component.downsampled_width),
                                  static_cast<int>(component.downsampled_height));
    }
    if (info_.num_components == 3) {
      image->colors.step_x = info_.max_h_samp_factor / info_.comp_info[1].h_samp_factor;
      image->colors.step_y = info_.max_v_samp_factor / info_.comp_info[1].v_samp_factor;
    }
    // Rows of blocks that reach over the lower border.
    Image<uint8_t> spare(image->gray.width(), 1);
    return guarded([&] {
      while (info_.output_scanline < info_.output_height) read_rows_of_blocks(planes, spare.row(0));
      jpeg_finish_decompress(&info_);
    });
  }

  void read_rows_of_blocks(const std::array<Image<uint8_t>*, 3>& planes, uint8_t* spare) {
    JSAMPROW rows[3][kMaxRows];
    JSAMPARRAY components[3] = {rows[0], rows[1], rows[2]};
    const int block = static_cast<int>(info_.output_scanline) / (info_.max_v_samp_factor * DCTSIZE);
    for (int c = 0; c < info_.num_components; ++c) {
      const int count = info_.comp_info[c].v_samp_factor * DCTSIZE;
      for (int i = 0; i < count; ++i) {
        const int y = block * count + i;
        rows[c][i] = y < planes[c]->height() ? planes[c]->row(y) : spare;
      }
    }
    jpeg_read_raw_data(&info_, components, static_cast<JDIMENSION>(info_.max_v_samp_factor * DCTSIZE));
  }

  bool read_colors(DecodedImage* image) {
    const bool cmyk = info_.num_components == 4;
    info_.out_color_space = cmyk ? JCS_CMYK : JCS_RGB;
    if (!guarded([this] { jpeg_start_decompress(&info_); })) return false;
    ColorPlanes& colors = image->colors;
    colors.values_per_pixel = info_.output_components;
    colors.rgb = Image<uint8_t>(static_cast<int>(info_.output_width) * info_.output_components,
                                static_cast<int>(info_.output_height));
    const bool read = guarded([&] {
      while (info_.output_scanline < info_.output_height) {
        JSAMPROW row = colors.rgb.row(static_cast<int>(info_.output_scanline));
        jpeg_read_scanlines(&info_, &row, 1);
      }
      jpeg_finish_decompress(&info_);
    });
    if (cmyk) print_on_black(&colors);
    image->gray = gray_of(colors);
    return read;
  }

  // Files of CMYK hold the light that the inks leave, as Adobe began it.
  static void print_on_black(ColorPlanes* colors) {
    for (int y = 0; y < colors->rgb.height(); ++y) {
      uint8_t* p = colors->rgb.row(y);
      for (int x = 0; x < colors->rgb.width(); x += 4, p += 4) {
        for (int c = 0; c < 3; ++c) p[c] = static_cast<uint8_t>(p[c] * p[3] / 255);
      }
    }
  }

  std::string_view bytes_;
  jpeg_decompress_struct info_{};
  ErrorTrap trap_{};
};

}  // namespace

Result<DecodedImage> decode_jpeg(std::string_view bytes) {
  return JpegDecoder(bytes).decode();
}

}  // namespace raysfm
