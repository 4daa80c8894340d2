#include "raysfm/page/frame_pictures.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdlib>

#include "raysfm/frames/jpeg_writer.h"

namespace raysfm {
namespace {

constexpr int kMostSide = 640;  // pixels
constexpr int kQuality = 80;
constexpr size_t kMostBytes = 64 << 20;
constexpr int kAround = 30;  // frames before the one that is wanted that are kept as well

// Means over squares of pixels, as few as leave no side longer than kMostSide.
Image<uint8_t> smaller(const InputFrame& frame) {
  const int longer = std::max(frame.gray.width(), frame.gray.height());
  const int side = (longer + kMostSide - 1) / kMostSide;
  Image<uint8_t> rgb(3 * (frame.gray.width() / side), frame.gray.height() / side);
  for (int y = 0; y < rgb.height(); ++y) {
    for (int x = 0; x < rgb.width() / 3; ++x) {
      std::array<int, 3> sum = {0, 0, 0};
      for (int k = 0; k < side * side; ++k) {
        const int u = x * side + k % side, v = y * side + k / side;
        const uint8_t grey = frame.gray.row(v)[u];
        const std::array<uint8_t, 3> pixel =
            frame.colors.empty() ? std::array<uint8_t, 3>{grey, grey, grey} : frame.colors.at(u, v, grey);
        for (int c = 0; c < 3; ++c) sum[c] += pixel[c];
      }
      for (int c = 0; c < 3; ++c) rgb.row(y)[3 * x + c] = static_cast<uint8_t>(sum[c] / (side * side));
    }
  }
  return rgb;
}

}  // namespace

FramePictures::FramePictures(std::vector<std::string> inputs, bool mono, const TimeRange& range)
    : inputs_(std::move(inputs)), mono_(mono), range_(range) {}

Result<void> FramePictures::open() {
  reader_.reset();
  // A device has no earlier frames, and would begin to film.
  for (const std::string& input : inputs_) {
    if (input.starts_with("/dev/")) return bad_input(fmt::format("{}: a device cannot be read again", input));
  }
  Result<Input> opened =
      open_input(inputs_, {.mono = mono_, .ignore_calibration = true, .threads = 1, .range = range_});
  if (!opened) return opened.error();
  input_ = *std::move(opened);
  if (mono_) input_.streams.resize(1);
  streams_ = static_cast<int>(input_.streams.size());
  reader_.emplace(input_.streams);
  next_ = 0;
  return {};
}

Result<std::string> FramePictures::jpeg(int frame, int stream) {
  const int wish = ++wishes_;
  const std::lock_guard lock(reading_);
  if (frame < 0 || stream < 0 || stream >= streams_) return bad_input("no such picture");
  const Key key(frame, stream);
  if (!kept_.contains(key)) {
    if (auto r = read_up_to(frame, wish); !r) return r.error();
  }
  const auto found = kept_.find(key);
  if (found == kept_.end()) return bad_input("no such picture");
  return found->second;
}

Result<void> FramePictures::read_up_to(int frame, int wish) {
  if (next_ > frame || !reader_) {
    if (auto r = open(); !r) return r;
  }
  while (next_ <= frame) {
    if (wish != wishes_) return bad_input("another picture is wanted");
    const Result<std::vector<InputFrame>> frames = reader_->next();
    if (!frames) return frames.error();
    if (frames->empty()) return bad_input("the input has no such frame any more");
    if (next_ >= frame - kAround) {
      if (auto r = keep(*frames); !r) return r;
    }
    ++next_;
  }
  forget_far_from(frame);
  return {};
}

Result<void> FramePictures::keep(const std::vector<InputFrame>& frames) {
  for (int s = 0; s < streams_; ++s) {
    if (frames[s].gray.empty() || kept_.contains({next_, s})) continue;
    Result<std::string> picture = encode_jpeg(smaller(frames[s]), kQuality);
    if (!picture) return picture.error();
    kept_bytes_ += picture->size();
    kept_[{next_, s}] = *std::move(picture);
  }
  return {};
}

void FramePictures::forget_far_from(int frame) {
  while (kept_bytes_ > kMostBytes) {
    const auto first = kept_.begin(), last = std::prev(kept_.end());
    const bool is_first = std::abs(first->first.first - frame) > std::abs(last->first.first - frame);
    const auto far = is_first ? first : last;
    kept_bytes_ -= far->second.size();
    kept_.erase(far);
  }
}

}  // namespace raysfm
