#pragma once

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/imgutils.h>
}

#include <cstdint>
#include <filesystem>
#include <functional>
#include <stdexcept>

namespace raysfm::testing_support {

// How a test video is made. FFV1 is lossless, so that a test knows every sample.
struct VideoRecipe {
  int width = 32, height = 24, frames = 5;
  AVCodecID codec = AV_CODEC_ID_FFV1;
  AVPixelFormat pixels = AV_PIX_FMT_YUV420P;
  AVColorRange range = AVCOL_RANGE_MPEG;
  AVRational pixel_aspect = {0, 1};  // nothing said
  // Presentation time of a frame in milliseconds.
  std::function<int64_t(int)> milliseconds = [](int i) { return 40 * i; };
  // Fills the planes of a frame.
  std::function<void(int, AVFrame*)> paint;
};

// Writes a video; the extension of the path chooses the container. Throws where FFmpeg lacks what is asked
// for.
inline void write_video(const std::filesystem::path& path, const VideoRecipe& recipe) {
  const auto check = [](int code) {
    if (code < 0) throw std::runtime_error("FFmpeg cannot write the test video");
  };
  AVFormatContext* format = nullptr;
  check(avformat_alloc_output_context2(&format, nullptr, nullptr, path.c_str()));
  AVCodecContext* codec = avcodec_alloc_context3(avcodec_find_encoder(recipe.codec));
  codec->width = recipe.width;
  codec->height = recipe.height;
  codec->pix_fmt = recipe.pixels;
  codec->color_range = recipe.range;
  codec->sample_aspect_ratio = recipe.pixel_aspect;
  codec->time_base = {1, 1000};
  codec->strict_std_compliance = FF_COMPLIANCE_UNOFFICIAL;
  check(avcodec_open2(codec, codec->codec, nullptr));
  AVStream* stream = avformat_new_stream(format, nullptr);
  check(avcodec_parameters_from_context(stream->codecpar, codec));
  stream->time_base = {1, 1000};
  stream->sample_aspect_ratio = recipe.pixel_aspect;
  stream->avg_frame_rate = {25, 1};
  check(avio_open(&format->pb, path.c_str(), AVIO_FLAG_WRITE));
  check(avformat_write_header(format, nullptr));
  AVPacket* packet = av_packet_alloc();
  const auto drain = [&] {
    while (avcodec_receive_packet(codec, packet) >= 0) {
      av_packet_rescale_ts(packet, {1, 1000}, stream->time_base);
      packet->stream_index = stream->index;
      check(av_interleaved_write_frame(format, packet));
    }
  };
  for (int i = 0; i < recipe.frames; ++i) {
    AVFrame* frame = av_frame_alloc();
    frame->width = recipe.width;
    frame->height = recipe.height;
    frame->format = recipe.pixels;
    frame->color_range = recipe.range;
    frame->pts = recipe.milliseconds(i);
    check(av_frame_get_buffer(frame, 0));
    recipe.paint(i, frame);
    check(avcodec_send_frame(codec, frame));
    av_frame_free(&frame);
    drain();
  }
  check(avcodec_send_frame(codec, nullptr));
  drain();
  check(av_write_trailer(format));
  avio_closep(&format->pb);
  av_packet_free(&packet);
  avcodec_free_context(&codec);
  avformat_free_context(format);
}

}  // namespace raysfm::testing_support
