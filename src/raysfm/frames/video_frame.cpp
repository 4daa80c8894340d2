#include "raysfm/frames/video_frame.h"

extern "C" {
#include <libavutil/frame.h>
#include <libavutil/pixdesc.h>
#include <libswscale/swscale.h>
}

#include <algorithm>
#include <cstring>
#include <new>
#include <vector>

#include "raysfm/frames/decoded_image.h"
#include "raysfm/image/luma.h"

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

void copy_luma(const AVFrame& frame, const AVPixFmtDescriptor& format, GrayImage* gray) {
  const AVComponentDescriptor& luma = format.comp[0];
  const bool full = is_full_range(frame, format);
  const int64_t low = full ? 0 : int64_t{16} << (luma.depth - 8);
  const int64_t high = full ? (int64_t{1} << luma.depth) - 1 : int64_t{235} << (luma.depth - 8);
  const bool is_side_by_side = luma.depth == 8 && luma.step == 1;
  std::vector<uint8_t> table(is_side_by_side ? 0 : size_t{1} << luma.depth);
  for (size_t i = 0; i < table.size(); ++i) table[i] = stretched_level(static_cast<int64_t>(i), low, high);
  for (int y = 0; y < frame.height; ++y) {
    const uint8_t* in = frame.data[luma.plane] + ptrdiff_t{y} * frame.linesize[luma.plane] + luma.offset;
    uint8_t* out = gray->row(y);
    if (is_side_by_side && full) {
      std::memcpy(out, in, frame.width);
    } else if (is_side_by_side) {
      stretch_luma(in, frame.width, out);
    } else if (luma.depth == 8) {
      for (int x = 0; x < frame.width; ++x) out[x] = table[in[ptrdiff_t{x} * luma.step]];
    } else {
      for (int x = 0; x < frame.width; ++x) {
        uint16_t value;
        std::memcpy(&value, in + ptrdiff_t{x} * luma.step, sizeof(value));
        out[x] = table[std::min<size_t>(value >> luma.shift, table.size() - 1)];
      }
    }
  }
}

GrayImage chroma_of(const AVFrame& frame, const AVPixFmtDescriptor& format, int component) {
  const AVComponentDescriptor& chroma = format.comp[component];
  GrayImage image(AV_CEIL_RSHIFT(frame.width, format.log2_chroma_w),
                  AV_CEIL_RSHIFT(frame.height, format.log2_chroma_h));
  for (int y = 0; y < image.height(); ++y) {
    const uint8_t* in =
        frame.data[chroma.plane] + ptrdiff_t{y} * frame.linesize[chroma.plane] + chroma.offset;
    uint8_t* out = image.row(y);
    if (chroma.depth == 8 && chroma.step == 1) {
      std::memcpy(out, in, image.width());
      continue;
    }
    for (int x = 0; x < image.width(); ++x, in += chroma.step) {
      uint16_t value = *in;
      if (chroma.depth > 8) std::memcpy(&value, in, sizeof(value));
      out[x] = static_cast<uint8_t>(value >> chroma.shift >> (chroma.depth - 8));
    }
  }
  return image;
}

// Shares of chroma in the colours, from the shares of red and blue in luma.
ColorPlanes::Mix mix_of(const AVFrame& frame, bool full_range) {
  float red = 0.299f, blue = 0.114f;
  if (frame.colorspace == AVCOL_SPC_BT709) red = 0.2126f, blue = 0.0722f;
  if (frame.colorspace == AVCOL_SPC_BT2020_NCL) red = 0.2627f, blue = 0.0593f;
  if (frame.colorspace == AVCOL_SPC_SMPTE240M) red = 0.212f, blue = 0.087f;
  const float green = 1 - red - blue;
  const float scale = 2 * (full_range ? 1.f : 255.f / 224.f);
  return {.red_cr = scale * (1 - red),
          .green_cb = -scale * (1 - blue) * blue / green,
          .green_cr = -scale * (1 - red) * red / green,
          .blue_cb = scale * (1 - blue)};
}

void copy_chroma(const AVFrame& frame, const AVPixFmtDescriptor& format, ColorPlanes* colors) {
  colors->cb = chroma_of(frame, format, 1);
  colors->cr = chroma_of(frame, format, 2);
  colors->step_x = 1 << format.log2_chroma_w;
  colors->step_y = 1 << format.log2_chroma_h;
  colors->mix = mix_of(frame, is_full_range(frame, format));
}

}  // namespace

VideoFrameConverter::~VideoFrameConverter() {
  sws_freeContext(scaler_);
}

bool VideoFrameConverter::convert(const AVFrame& frame, GrayImage* gray, ColorPlanes* colors) {
  const AVPixelFormat pixels = static_cast<AVPixelFormat>(frame.format);
  const AVPixFmtDescriptor* format = av_pix_fmt_desc_get(pixels);
  if (!format) return false;
  if (is_luma(*format)) {
    *gray = GrayImage(frame.width, frame.height);
    copy_luma(frame, *format, gray);
    if (format->nb_components > 2) copy_chroma(frame, *format, colors);
    return true;
  }
  scaler_ = sws_getCachedContext(scaler_, frame.width, frame.height, pixels, frame.width, frame.height,
                                 AV_PIX_FMT_RGB24, SWS_BILINEAR, nullptr, nullptr, nullptr);
  if (!scaler_ && sws_isSupportedInput(pixels)) throw std::bad_alloc();
  if (!scaler_) return false;
  sws_setColorspaceDetails(scaler_, sws_getCoefficients(frame.colorspace), is_full_range(frame, *format),
                           sws_getCoefficients(SWS_CS_DEFAULT), 1, 0, 1 << 16, 1 << 16);
  colors->rgb = Image<uint8_t>(3 * frame.width, frame.height);
  uint8_t* planes[4] = {colors->rgb.row(0), nullptr, nullptr, nullptr};
  const int strides[4] = {static_cast<int>(colors->rgb.view().stride), 0, 0, 0};
  if (sws_scale(scaler_, frame.data, frame.linesize, 0, frame.height, planes, strides) != frame.height)
    return false;
  *gray = gray_of(*colors);
  return true;
}

}  // namespace raysfm
