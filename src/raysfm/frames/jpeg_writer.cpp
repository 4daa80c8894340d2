#include "raysfm/frames/jpeg_writer.h"

#include <csetjmp>
#include <cstddef>
#include <cstdio>
#include <cstdlib>

// It comes after <cstddef> and <cstdio>, which it needs.
#include <jpeglib.h>

namespace raysfm {
namespace {

// libjpeg leaves by a jump where it cannot go on.
struct WriteTrap {
  jpeg_error_mgr manager;  // the first member: libjpeg knows no other
  std::jmp_buf jump;
};

void leave_writing(j_common_ptr info) {
  std::longjmp(reinterpret_cast<WriteTrap*>(info->err)->jump, 1);
}

// False where libjpeg left. Nothing here has a destructor. `bytes` is to be freed either way.
bool compress(ImageView<const uint8_t> rgb, int quality, unsigned char** bytes, unsigned long* size) {
  jpeg_compress_struct info;
  WriteTrap trap;
  info.err = jpeg_std_error(&trap.manager);
  trap.manager.error_exit = leave_writing;
  if (setjmp(trap.jump)) {
    jpeg_destroy_compress(&info);
    return false;
  }
  jpeg_create_compress(&info);
  jpeg_mem_dest(&info, bytes, size);
  info.image_width = static_cast<JDIMENSION>(rgb.width / 3);
  info.image_height = static_cast<JDIMENSION>(rgb.height);
  info.input_components = 3;
  info.in_color_space = JCS_RGB;
  jpeg_set_defaults(&info);
  jpeg_set_quality(&info, quality, TRUE);
  jpeg_start_compress(&info, TRUE);
  while (info.next_scanline < info.image_height) {
    JSAMPROW row = const_cast<JSAMPROW>(rgb.row(static_cast<int>(info.next_scanline)));
    jpeg_write_scanlines(&info, &row, 1);
  }
  jpeg_finish_compress(&info);
  jpeg_destroy_compress(&info);
  return true;
}

}  // namespace

Result<std::string> encode_jpeg(ImageView<const uint8_t> rgb, int quality) {
  if (rgb.width < 3 || rgb.height < 1 || rgb.width / 3 > JPEG_MAX_DIMENSION ||
      rgb.height > JPEG_MAX_DIMENSION) {
    return bad_input("a JPEG image has 1 to 65500 pixels a side");
  }
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  const bool done = compress(rgb, quality, &bytes, &size);
  std::string file(reinterpret_cast<const char*>(bytes), done ? size : 0);
  std::free(bytes);
  if (!done) return internal_error("not enough memory for a JPEG image");
  return file;
}

}  // namespace raysfm
