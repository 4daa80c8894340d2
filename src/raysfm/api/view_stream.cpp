#include "raysfm/api/view_stream.h"

namespace raysfm {
namespace {

constexpr size_t kAhead = 8;  // views

Result<ViewPtr> detected(InputFrame frame, const HarrisOptions& options) {
  thread_local HarrisDetector detector;
  auto view = std::make_shared<View>();
  view->frame = frame.index;
  view->timestamp = frame.timestamp;
  view->name = std::move(frame.name);
  view->image = std::move(frame.gray);
  view->bgr = std::move(frame.bgr);
  detect(detector, options, view.get());
  return ViewPtr(std::move(view));
}

template <typename T>
std::future<T> ready(T value) {
  std::promise<T> promise;
  promise.set_value(std::move(value));
  return promise.get_future();
}

}  // namespace

ViewStream::ViewStream(FrameSource& source, const HarrisOptions& options, int threads)
    : source_(source), options_(options), pool_(std::make_unique<ThreadPool>(std::max(0, threads - 1))) {
  if (threads > 1) reader_ = std::jthread([this](const std::stop_token& stop) { read_ahead(stop); });
}

ViewStream::~ViewStream() {
  if (reader_.joinable()) {
    reader_.request_stop();
    changed_.notify_all();
    reader_.join();
  }
  pool_.reset();
}

std::future<ViewStream::Item> ViewStream::read() {
  const Clock::time_point start = Clock::now();
  Result<std::optional<InputFrame>> frame = source_.next();
  if (!frame) return ready<Item>(frame.error());
  if (!frame->has_value()) return ready<Item>(ViewPtr());
  decode_timing_.add(milliseconds_since(start));
  auto shared = std::make_shared<InputFrame>(std::move(**frame));
  return pool_->submit([this, shared] { return detected(std::move(*shared), options_); });
}

void ViewStream::read_ahead(const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    const int before = static_cast<int>(decode_timing_.count);
    std::future<Item> item = read();
    const bool last = decode_timing_.count == before;  // the end, or an error
    std::unique_lock lock(mutex_);
    queue_.push_back(std::move(item));
    changed_.notify_all();
    if (last) return;
    changed_.wait(lock, stop, [this] { return queue_.size() < kAhead; });
  }
}

Result<ViewPtr> ViewStream::next() {
  if (ended_) return ViewPtr();
  std::future<Item> item;
  if (reader_.joinable()) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return !queue_.empty(); });
    item = std::move(queue_.front());
    queue_.pop_front();
    changed_.notify_all();
  } else {
    item = read();
  }
  Item view = item.get();
  ended_ = !view || !*view;
  return view;
}

}  // namespace raysfm
