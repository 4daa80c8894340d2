#include "raysfm/streams/view_stream.h"

#include <fmt/format.h>

#include <algorithm>
#include <exception>
#include <system_error>

namespace raysfm {
namespace {

constexpr size_t kAhead = 8;  // views
// Part of the frames: where more repeat others, the user hears of it.
constexpr double kManyRepeats = 0.1;

template <typename T>
std::future<T> ready(T value) {
  std::promise<T> promise;
  promise.set_value(std::move(value));
  return promise.get_future();
}

}  // namespace

ViewStream::ViewStream(const std::vector<std::unique_ptr<FrameSource>>& sources, ViewMaker maker, int threads,
                       PassedViews passed)
    : sources_(sources),
      maker_(std::move(maker)),
      passed_(std::move(passed)),
      pool_(std::make_unique<ThreadPool>(std::max(0, threads - 1))) {
  if (threads <= 1) return;
  try {
    reader_ = std::jthread([this](const std::stop_token& stop) { read_ahead(stop); });
  } catch (const std::system_error&) {  // no more threads: next() reads itself
  }
}

ViewStream::~ViewStream() {
  finish();
  pool_.reset();
}

const StageTiming& ViewStream::finish() {
  if (reader_.joinable()) {
    reader_.request_stop();
    changed_.notify_all();
    reader_.join();
  }
  return decode_timing_;
}

// Asked for each frame in its turn, by one thread at a time.
ViewStream::Showing ViewStream::showing(const Frames& frames) {
  Showing shown{-1, repeats_.repeats()};
  std::vector<GrayView> pictures;
  for (const InputFrame& frame : frames) {
    if (!frame.defect.empty()) return shown;
    pictures.push_back(frame.gray);
  }
  shown.same_as = repeats_.original_of(frames[0].index, pictures);
  return shown;
}

std::string ViewStream::note() const {
  std::string note = sources_.note();
  const int64_t frames = decode_timing_.count;
  if (repeats_.repeats() <= kManyRepeats * static_cast<double>(frames)) return note;
  return note + fmt::format("{}{} of {} frames show the same picture as the one before, and have its pose",
                            note.empty() ? "" : "; ", repeats_.repeats(), frames);
}

ViewStream::Item ViewStream::made(Frames frames, const Showing& shown) const {
  auto view = std::make_shared<View>();
  view->frame = frames[0].index;
  view->timestamp = frames[0].timestamp;
  view->name = frames[0].name;
  view->same_as = shown.same_as;
  view->repeats = shown.repeats;
  if (shown.same_as >= 0) return ViewPtr(std::move(view));
  std::vector<Picture> pictures;
  for (InputFrame& frame : frames) {
    if (view->defect.empty()) view->defect = frame.defect;
    pictures.push_back({std::move(frame.gray), std::move(frame.colors)});
  }
  if (!view->defect.empty()) return ViewPtr(std::move(view));
  const auto needed = passed_.needed.find(view->frame);
  const bool is_passed = view->frame < passed_.end;
  if (is_passed && needed == passed_.needed.end()) return ViewPtr(std::move(view));
  maker_.look(std::move(pictures), view.get());
  if (is_passed ? needed->second : detect_ahead_.load()) maker_.detect(view.get());
  return ViewPtr(std::move(view));
}

std::future<ViewStream::Item> ViewStream::read() {
  const Clock::time_point start = Clock::now();
  Result<Frames> frames = sources_.next();
  if (!frames) return ready<Item>(frames.error());
  if (frames->empty()) return ready<Item>(ViewPtr());
  decode_timing_.add(milliseconds_since(start));
  const Showing shown = showing(*frames);
  if (shown.same_as >= 0) return ready<Item>(made(*std::move(frames), shown));
  auto shared = std::make_shared<Frames>(std::move(*frames));
  return pool_->submit([this, shared, shown] { return made(std::move(*shared), shown); });
}

void ViewStream::read_ahead(const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    const int before = static_cast<int>(decode_timing_.count);
    std::future<Item> item;
    try {
      item = read();
    } catch (...) {  // out of memory; thrown again by next()
      std::promise<Item> failed;
      failed.set_exception(std::current_exception());
      item = failed.get_future();
    }
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
