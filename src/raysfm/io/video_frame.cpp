#include "raysfm/io/video_frame.h"

extern "C" {
#include <libavutil/frame.h>
#include <libavutil/pixdesc.h>
#include <libswscale/swscale.h>
}

#include <algorithm>
#include <array>
#include <cstring>

namespace raysfm {
namespace {

bool is_full_range(const AVFrame& frame, const AVPixFmtDescriptor& format) {
  if (frame.color_range == AVCOL_RANGE_JPEG) return true;
  if (frame.color_range == AVCOL_RANGE_MPEG) return false;
  switch (frame.format) {
    case AV_PIX_FMT_YUVJ411P:
    case AV_PIX_FMT_YUVJ420P:
    case AV_PIX_FMT_YUVJ422P:
    case AV_PIX_FMT_YUVJ440P:
    case AV_PIX_FMT_YUVJ444P:
      return true;
    default:
      return format.nb_components <= 2;  // a grey format that does not say
  }
}

bool is_luma(const AVPixFmtDescriptor& format) {
  constexpr uint64_t kOther = AV_PIX_FMT_FLAG_RGB | AV_PIX_FMT_FLAG_PAL | AV_PIX_FMT_FLAG_BITSTREAM |
                              AV_PIX_FMT_FLAG_HWACCEL | AV_PIX_FMT_FLAG_BAYER | AV_PIX_FMT_FLAG_FLOAT |
                              AV_PIX_FMT_FLAG_BE;
  return !(format.flags & kOther) && format.comp[0].depth >= 8 && format.comp[0].depth <= 16;
}

// Level `value` of `depth` bits in 8 bits; `low` and `high` are what become 0 and 255.
uint8_t stretched(int value, int64_t low, int64_t high) {
  const int64_t level = ((value - low) * 255 * 2 + (high - low)) / (2 * (high - low));
  return static_cast<uint8_t>(std::clamp<int64_t>(level, 0, 255));
}

void copy_luma(const AVFrame& frame, const AVPixFmtDescriptor& format, GrayImage* gray) {
  const AVComponentDescriptor& luma = format.comp[0];
  const bool full = is_full_range(frame, format);
  const int64_t low = full ? 0 : int64_t{16} << (luma.depth - 8);
  const int64_t high = full ? (int64_t{1} << luma.depth) - 1 : int64_t{235} << (luma.depth - 8);
  std::array<uint8_t, 256> table;
  for (int i = 0; i < 256; ++i) table[i] = stretched(i, low, high);
  for (int y = 0; y < frame.height; ++y) {
    const uint8_t* in = frame.data[luma.plane] + ptrdiff_t{y} * frame.linesize[luma.plane] + luma.offset;
    uint8_t* out = gray->row(y);
    if (luma.depth == 8 && luma.step == 1 && full) {
      std::memcpy(out, in, frame.width);
    } else if (luma.depth == 8) {
      for (int x = 0; x < frame.width; ++x) out[x] = table[in[ptrdiff_t{x} * luma.step]];
    } else {
      for (int x = 0; x < frame.width; ++x) {
        uint16_t value;
        std::memcpy(&value, in + ptrdiff_t{x} * luma.step, sizeof(value));
        out[x] = stretched(value >> luma.shift, low, high);
      }
    }
  }
}

void gray_of(const Image<uint8_t>& rgb, GrayImage* gray) {
  for (int y = 0; y < gray->height(); ++y) {
    const uint8_t* in = rgb.row(y);
    uint8_t* out = gray->row(y);
    for (int x = 0; x < gray->width(); ++x, in += 3) {
      out[x] = static_cast<uint8_t>((77 * in[0] + 150 * in[1] + 29 * in[2] + 128) >> 8);
    }
  }
}

}  // namespace

VideoFrameConverter::~VideoFrameConverter() {
  sws_freeContext(scaler_);
}

bool VideoFrameConverter::convert(const AVFrame& frame, GrayImage* gray, ColorPlanes* colors) {
  const AVPixelFormat pixels = static_cast<AVPixelFormat>(frame.format);
  const AVPixFmtDescriptor* format = av_pix_fmt_desc_get(pixels);
  if (!format) return false;
  *gray = GrayImage(frame.width, frame.height);
  const bool luma = is_luma(*format);
  if (luma) copy_luma(frame, *format, gray);
  if (luma && format->nb_components <= 2) return true;

  scaler_ = sws_getCachedContext(scaler_, frame.width, frame.height, pixels, frame.width, frame.height,
                                 AV_PIX_FMT_RGB24, SWS_BILINEAR, nullptr, nullptr, nullptr);
  if (!scaler_) return false;
  sws_setColorspaceDetails(scaler_, sws_getCoefficients(frame.colorspace), is_full_range(frame, *format),
                           sws_getCoefficients(SWS_CS_DEFAULT), 1, 0, 1 << 16, 1 << 16);
  colors->rgb = Image<uint8_t>(3 * frame.width, frame.height);
  uint8_t* planes[4] = {colors->rgb.row(0), nullptr, nullptr, nullptr};
  const int strides[4] = {static_cast<int>(colors->rgb.view().stride), 0, 0, 0};
  if (sws_scale(scaler_, frame.data, frame.linesize, 0, frame.height, planes, strides) != frame.height)
    return false;
  if (!luma) gray_of(colors->rgb, gray);
  return true;
}

}  // namespace raysfm
