#include "raysfm/frames/video_source.h"

#include <fmt/format.h>

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/display.h>
}

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <new>
#include <optional>
#include <set>
#include <string_view>
#include <utility>

#include "raysfm/core/memory.h"
#include "raysfm/frames/video_frame.h"

namespace raysfm {
namespace {

constexpr int kMaxVideoSide = 32768;
constexpr int kMaxFailures = 1000;  // of the decoder in a row, without asking for data
constexpr int64_t kMaxPixels = int64_t{1} << 28;

struct CloseFormat {
  void operator()(AVFormatContext* p) const { avformat_close_input(&p); }
};
struct FreeCodec {
  void operator()(AVCodecContext* p) const { avcodec_free_context(&p); }
};
struct FreeFrame {
  void operator()(AVFrame* p) const { av_frame_free(&p); }
};
struct FreePacket {
  void operator()(AVPacket* p) const { av_packet_free(&p); }
};

std::string reason(int code) {
  std::array<char, AV_ERROR_MAX_STRING_SIZE> text{};
  av_strerror(code, text.data(), text.size());
  return text.data();
}

class VideoSource : public FrameSource {
 public:
  VideoSource(std::string path, const DecoderOptions& options)
      : path_(std::move(path)), fps_(options.fps), threads_(options.threads) {}

  // Opens, and decodes up to the first frame without a defect.
  Result<void> open(const char* device_format);

  Result<std::optional<InputFrame>> next() override {
    if (auto r = fill(); !r) return r.error();
    std::optional<InputFrame> frame;
    if (!ahead_.empty()) {
      frame = std::move(ahead_.front());
      ahead_.pop_front();
      number(given_++, &*frame);
    }
    return frame;
  }

  int width() const override { return width_; }
  int height() const override { return height_; }
  double pixel_aspect() const override;
  TimeRange span() const override {
    const double end = end_time();
    return {ahead_.empty() ? 0 : ahead_.front().timestamp, std::isfinite(end) ? end : 0};
  }
  Result<void> cut(const TimeRange& range) override;
  int frame_count() const override {
    if (!range_.is_all()) return -1;
    const int64_t count = stream_->nb_frames;
    return count > 0 && count < 1 << 30 ? static_cast<int>(count) : -1;
  }
  std::string description() const override {
    return fmt::format("{}: {}, {}x{}, {:.4g} frames/s", path_, avcodec_get_name(stream_->codecpar->codec_id),
                       width_, height_, rate_);
  }
  std::string note() const override;

 private:
  static void number(int index, InputFrame* frame) {
    frame->index = index;
    frame->name = fmt::format("frame-{:06}", index);
  }
  Result<void> fill();
  Result<void> seek(double seconds);
  void forget_decoded();
  double end_time() const;
  Result<void> decode();
  Result<void> decode_next();
  Result<void> append_frame();
  void append_lost(int64_t before);
  void count_lost();
  InputFrame numbered_frame(int64_t pts);
  std::string defect();
  int open_decoder(const AVCodec* decoder, int threads);
  Result<void> open_codec();
  void find_rotation();
  void feed();
  double timestamp(int64_t pts);
  bool cut_short() const;

  std::string path_;
  double fps_;
  int threads_;
  std::unique_ptr<AVFormatContext, CloseFormat> format_;
  std::unique_ptr<AVCodecContext, FreeCodec> codec_;
  std::unique_ptr<AVFrame, FreeFrame> frame_{av_frame_alloc()};
  std::unique_ptr<AVPacket, FreePacket> packet_{av_packet_alloc()};
  AVStream* stream_ = nullptr;  // of format_
  VideoFrameConverter converter_;
  std::deque<InputFrame> ahead_;  // decoded and not given away
  std::set<int64_t> awaited_;     // presentation times of what the decoder got and has not given back
  int width_ = 0, height_ = 0;
  double rate_ = 0;  // frames per second that the container says, or 25
  int index_ = 0;    // of the frame that is decoded next
  int given_ = 0;    // frames given away
  bool is_device_ = false;
  TimeRange range_;
  double last_timestamp_ = -HUGE_VAL;
  bool done_ = false;
  int lost_ = 0;  // frames that did not decode and have no place yet
  int failures_in_a_row_ = 0;
  int repaired_times_ = 0;    // timestamps that did not increase
  std::string read_failure_;  // why reading stopped, if not at the end
  int rotation_ = 0;          // degrees
};

Result<void> VideoSource::open(const char* device_format) {
  const AVInputFormat* input_format = nullptr;
  is_device_ = device_format != nullptr;
  if (device_format) {
    input_format = av_find_input_format(device_format);
    if (!input_format) return bad_input(path_ + ": video devices are not supported by this FFmpeg");
  }
  AVFormatContext* format = avformat_alloc_context();
  AVDictionary* options = nullptr;
  if (!device_format) av_dict_set(&options, "protocol_whitelist", "file", 0);
  if (device_format && fps_ > 0) av_dict_set(&options, "framerate", fmt::format("{}", fps_).c_str(), 0);
  const std::string url = device_format ? path_ : "file:" + path_;
  const int opened = avformat_open_input(&format, url.c_str(), input_format, &options);
  av_dict_free(&options);
  if (opened == AVERROR(ENOMEM)) throw std::bad_alloc();
  if (opened < 0) return bad_input(fmt::format("{}: no video that can be opened: {}", path_, reason(opened)));
  format_.reset(format);
  // FFmpeg draws text files as pictures; nobody means that.
  if (std::string_view(format->iformat->name) == "tty") return bad_input(path_ + ": no video but text");
  const int found = avformat_find_stream_info(format, nullptr);
  if (found == AVERROR(ENOMEM)) throw std::bad_alloc();
  if (found < 0) return bad_input(fmt::format("{}: no video that can be read: {}", path_, reason(found)));
  const Result<void> ready = open_codec();
  if (!ready) return ready;
  find_rotation();

  while (ahead_.empty() || !ahead_.back().defect.empty()) {
    if (auto r = decode(); !r) return r;
    if (done_ && width_ == 0) {
      return bad_input(path_ + ": the video has no frame that can be decoded; allowed: at least one");
    }
  }
  return {};
}

// The next frame of the range, if there is one, stands in front of those that are ahead.
Result<void> VideoSource::fill() {
  for (;;) {
    while (!ahead_.empty() && range_.is_before(ahead_.front().timestamp)) ahead_.pop_front();
    if (!ahead_.empty() || done_) break;
    if (auto r = decode(); !r) return r;
  }
  if (!ahead_.empty() && range_.is_behind(ahead_.front().timestamp)) {
    done_ = true;
    ahead_.clear();
  }
  return {};
}

Result<void> VideoSource::cut(const TimeRange& range) {
  if (is_device_) return FrameSource::cut(range);
  range_ = range;
  // Without times in the container every frame must be counted.
  if (fps_ <= 0) {
    if (auto r = seek(range.from); !r) return r;
  }
  if (auto r = fill(); !r) return r;
  if (ahead_.empty()) return no_frames_in(range, path_);
  return {};
}

void VideoSource::forget_decoded() {
  avcodec_flush_buffers(codec_.get());
  ahead_.clear();
  awaited_.clear();
  index_ = lost_ = failures_in_a_row_ = 0;
  last_timestamp_ = -HUGE_VAL;
  done_ = false;
}

// Goes on with the frames from a key frame before a time, if the container can tell; else as before.
Result<void> VideoSource::seek(double seconds) {
  constexpr double kEarlier = 1;  // seconds: an index may be of the times at which frames are decoded
  const double first = ahead_.front().timestamp;
  const auto go_to = [&](double time) {
    const auto pts = static_cast<int64_t>(time / av_q2d(stream_->time_base));
    const bool there = av_seek_frame(format_.get(), stream_->index, pts, AVSEEK_FLAG_BACKWARD) >= 0;
    if (there) forget_decoded();
    return there;
  };
  if (seconds - kEarlier <= first || !go_to(seconds - kEarlier)) return {};
  if (auto r = decode(); !r) return r;
  if (!ahead_.empty() && ahead_.front().timestamp <= seconds) return {};
  if (!go_to(first)) return bad_input(fmt::format("{}: cannot be read from {:g} seconds on", path_, seconds));
  return {};
}

// Zero or the negative cause of failure.
int VideoSource::open_decoder(const AVCodec* decoder, int threads) {
  codec_.reset(avcodec_alloc_context3(decoder));
  avcodec_parameters_to_context(codec_.get(), stream_->codecpar);
  codec_->thread_count = threads;
  codec_->max_pixels = kMaxPixels;
  codec_->pkt_timebase = stream_->time_base;
  return std::min(0, avcodec_open2(codec_.get(), decoder, nullptr));
}

Result<void> VideoSource::open_codec() {
  const AVCodec* decoder = nullptr;
  const int best = av_find_best_stream(format_.get(), AVMEDIA_TYPE_VIDEO, -1, -1, &decoder, 0);
  if (best < 0) return bad_input(path_ + ": has no video stream that can be decoded");
  stream_ = format_->streams[best];
  if (stream_->disposition & AV_DISPOSITION_ATTACHED_PIC)
    return bad_input(path_ + ": has a cover picture but no video");
  int opened = open_decoder(decoder, threads_);
  if (opened < 0 && threads_ != 1) opened = open_decoder(decoder, 1);  // no more threads to be had
  if (opened == AVERROR(ENOMEM)) throw std::bad_alloc();
  if (opened < 0) return bad_input(fmt::format("{}: {}: {}", path_, decoder->name, reason(opened)));
  rate_ = av_q2d(stream_->avg_frame_rate);
  if (!(rate_ > 0)) rate_ = av_q2d(stream_->r_frame_rate);
  if (!(rate_ > 0) || !std::isfinite(rate_)) rate_ = 25;
  return {};
}

double VideoSource::pixel_aspect() const {
  constexpr double kMost = 4;  // beyond it the number means nothing
  const double aspect = av_q2d(av_guess_sample_aspect_ratio(format_.get(), stream_, nullptr));
  return aspect >= 1 / kMost && aspect <= kMost ? aspect : 1;
}

void VideoSource::find_rotation() {
  const uint8_t* matrix = av_stream_get_side_data(stream_, AV_PKT_DATA_DISPLAYMATRIX, nullptr);
  if (!matrix) return;
  const double degrees = av_display_rotation_get(reinterpret_cast<const int32_t*>(matrix));
  if (std::isfinite(degrees)) rotation_ = static_cast<int>(std::lround(degrees));
}

// Gives the decoder its next packet, or the end.
void VideoSource::feed() {
  int code = av_read_frame(format_.get(), packet_.get());
  if (code == AVERROR(ENOMEM)) throw std::bad_alloc();
  if (code < 0) {
    if (code != AVERROR_EOF && read_failure_.empty()) read_failure_ = reason(code);
    avcodec_send_packet(codec_.get(), nullptr);
    return;
  }
  if (packet_->stream_index == stream_->index) {
    if (packet_->pts != AV_NOPTS_VALUE && !(packet_->flags & AV_PKT_FLAG_DISCARD))
      awaited_.insert(packet_->pts);
    code = avcodec_send_packet(codec_.get(), packet_.get());
    if (code < 0 && code != AVERROR_EOF) count_lost();
  }
  av_packet_unref(packet_.get());
}

// A frame that the decoder failed at. Without memory it fails with codes of all kinds.
void VideoSource::count_lost() {
  constexpr int64_t kBytesPerPixel = 16;            // a frame, and what the decoder keeps beside it
  constexpr int64_t kMostAsked = int64_t{1} << 28;  // a damaged size may be any
  const int64_t bytes = kBytesPerPixel * codec_->width * codec_->height;
  if (!memory_left(static_cast<size_t>(std::clamp<int64_t>(bytes, 1, kMostAsked)))) throw std::bad_alloc();
  ++lost_;
}

// Appends at least one frame, or is done.
Result<void> VideoSource::decode() try { return decode_next(); } catch (const std::bad_alloc&) {
  return internal_error(fmt::format("{}: not enough memory to decode frame {}", path_, index_));
}

Result<void> VideoSource::decode_next() {
  while (!done_) {
    const int code = avcodec_receive_frame(codec_.get(), frame_.get());
    if (code >= 0) {
      failures_in_a_row_ = 0;
      return append_frame();
    }
    if (code == AVERROR_EOF) {
      done_ = true;
      append_lost(INT64_MAX);
    } else if (code == AVERROR(EAGAIN)) {
      failures_in_a_row_ = 0;
      feed();
    } else {
      count_lost();
      if (++failures_in_a_row_ > kMaxFailures) done_ = true;
    }
  }
  return {};
}

double VideoSource::timestamp(int64_t pts) {
  double t = static_cast<double>(index_) / (fps_ > 0 ? fps_ : rate_);
  if (fps_ <= 0 && pts != AV_NOPTS_VALUE) {
    t = static_cast<double>(pts) * av_q2d(stream_->time_base);
    if (!(t > last_timestamp_)) {
      t = last_timestamp_ + 1 / rate_;
      ++repaired_times_;
    }
  }
  return t;
}

InputFrame VideoSource::numbered_frame(int64_t pts) {
  InputFrame frame;
  frame.timestamp = last_timestamp_ = timestamp(pts);
  return frame;
}

// Frames come in the order of their presentation: what the decoder got of an earlier time does not come any
// more. That need not be a loss, some packets show nothing, unless the decoder complained.
void VideoSource::append_lost(int64_t before) {
  for (auto it = awaited_.begin(); it != awaited_.end() && *it < before; it = awaited_.erase(it)) {
    if (lost_ == 0) continue;
    --lost_;
    InputFrame& frame = ahead_.emplace_back(numbered_frame(*it));
    frame.defect = fmt::format("{}: frame {} is damaged", path_, index_++);
  }
}

// Of the frame just decoded; the first without one gives the size.
std::string VideoSource::defect() {
  if ((frame_->flags & AV_FRAME_FLAG_CORRUPT) || frame_->decode_error_flags) {
    return fmt::format("{}: frame {} is damaged", path_, index_);
  }
  if (frame_->width > kMaxVideoSide || frame_->height > kMaxVideoSide) {
    return fmt::format("{}: frame {} has {} x {} pixels; allowed: sides up to {}", path_, index_,
                       frame_->width, frame_->height, kMaxVideoSide);
  }
  if (width_ == 0) {
    width_ = frame_->width;
    height_ = frame_->height;
  }
  if (frame_->width == width_ && frame_->height == height_) return {};
  return fmt::format("{}: frame {} has {} x {} pixels; allowed: the {} x {} of the first", path_, index_,
                     frame_->width, frame_->height, width_, height_);
}

Result<void> VideoSource::append_frame() {
  const int64_t pts = frame_->best_effort_timestamp;
  if (pts != AV_NOPTS_VALUE) append_lost(pts);
  awaited_.erase(pts);
  InputFrame& frame = ahead_.emplace_back(numbered_frame(pts));
  frame.defect = defect();
  if (frame.defect.empty() && !converter_.convert(*frame_, &frame.gray, &frame.colors)) {
    done_ = true;
    ahead_.pop_back();
    return bad_input(fmt::format("{}: frame {}: pixels of a format that cannot be converted", path_, index_));
  }
  ++index_;
  av_frame_unref(frame_.get());
  return {};
}

// Whether the container promises more than there was.
bool VideoSource::cut_short() const {
  if (!range_.is_all()) return false;
  if (stream_->nb_frames > 0) return stream_->nb_frames > index_ + lost_;
  if (fps_ > 0 || format_->duration_estimation_method != AVFMT_DURATION_FROM_STREAM) return false;
  constexpr double kSpare = 3;  // frames, for rounding and sound that lasts longer than the pictures
  return end_time() - last_timestamp_ > std::max(kSpare / rate_, 0.5);
}

// NaN where it is not known.
double VideoSource::end_time() const {
  if (fps_ > 0) return stream_->nb_frames > 0 ? static_cast<double>(stream_->nb_frames - 1) / fps_ : NAN;
  if (format_->duration == AV_NOPTS_VALUE) return NAN;
  const double start =
      format_->start_time == AV_NOPTS_VALUE ? 0 : static_cast<double>(format_->start_time) / AV_TIME_BASE;
  return start + static_cast<double>(format_->duration) / AV_TIME_BASE;
}

std::string VideoSource::note() const {
  std::string text;
  const auto add = [&](const std::string& part) { text += (text.empty() ? path_ + ": " : "; ") + part; };
  if (rotation_ != 0) add(fmt::format("a rotation by {} degrees in the metadata is ignored", rotation_));
  if (lost_ > 0) add(fmt::format("{} damaged frames were left out", lost_));
  if (!read_failure_.empty()) add("reading stopped early: " + read_failure_);
  if (done_ && cut_short()) add(fmt::format("cut short: {} frames could be decoded", index_));
  if (repaired_times_ > 0)
    add(fmt::format("{} timestamps did not increase and were replaced", repaired_times_));
  return text;
}

Result<std::unique_ptr<FrameSource>> open_source(const std::string& path, const DecoderOptions& options,
                                                 const char* device_format) try {
  auto source = std::make_unique<VideoSource>(path, options);
  const Result<void> opened = source->open(device_format);
  if (!opened) return opened.error();
  return std::unique_ptr<FrameSource>(std::move(source));
} catch (const std::bad_alloc&) {
  return internal_error(fmt::format("{}: not enough memory to open it", path));
}

}  // namespace

Result<std::unique_ptr<FrameSource>> open_video(const std::string& path, const DecoderOptions& options) {
  return open_source(path, options, nullptr);
}

Result<std::unique_ptr<FrameSource>> open_device(const std::string& path, const DecoderOptions& options) {
  return open_source(path, options, "v4l2");
}

void silence_ffmpeg() {
  av_log_set_level(AV_LOG_QUIET);
}

}  // namespace raysfm
