#pragma once

#include <pybind11/pybind11.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <exception>
#include <functional>
#include <mutex>
#include <optional>
#include <system_error>
#include <thread>
#include <utility>

#include "support.h"

namespace raysfm::python {

// A piece of work that takes long: it runs on a thread of its own without the interpreter's lock, while the
// calling thread hears signals. Ctrl-C, or an exception in a function of the caller's, stops it early, and is
// raised once it has ended, but for Stop.
class LongCall {
 public:
  // Set to end the work early.
  const std::atomic<bool>* stop() const { return &stop_; }

  // What `work` returns.
  template <typename Work>
  auto run(const Work& work) -> decltype(work()) {
    std::optional<decltype(work())> result;
    std::exception_ptr thrown;
    const auto guarded = [&] {
      try {
        result.emplace(work());
      } catch (...) {
        thrown = std::current_exception();
      }
    };
    run_aside(guarded);
    if (failure_) throw *std::exchange(failure_, std::nullopt);
    if (thrown) std::rethrow_exception(thrown);
    return *std::move(result);
  }

  // Calls a function of the caller's, from the work.
  template <typename Function>
  void call_back(const Function& function) {
    const pybind11::gil_scoped_acquire lock;
    if (failure_) return;
    try {
      function();
    } catch (pybind11::error_already_set& error) {
      if (is_stop(error)) {
        stop_ = true;
      } else {
        fail(error);
      }
    }
  }

 private:
  void fail(pybind11::error_already_set& error) {
    if (!failure_) failure_.emplace(std::move(error));
    stop_ = true;
  }

  void hear_signals() {
    const pybind11::gil_scoped_acquire lock;
    if (PyErr_CheckSignals() == 0) return;
    pybind11::error_already_set error;
    fail(error);
  }

  void run_aside(const std::function<void()>& work) {
    const pybind11::gil_scoped_release without_lock;
    std::mutex mutex;
    std::condition_variable ended;
    bool has_ended = false;
    std::jthread worker;
    try {
      worker = std::jthread([&] {
        work();
        const std::lock_guard lock(mutex);
        has_ended = true;
        ended.notify_one();
      });
    } catch (const std::system_error&) {  // the system gives no more threads
      return work();
    }
    std::unique_lock lock(mutex);
    while (!ended.wait_for(lock, std::chrono::milliseconds(50), [&] { return has_ended; })) {
      lock.unlock();
      hear_signals();
      lock.lock();
    }
  }

  std::atomic<bool> stop_ = false;
  std::optional<pybind11::error_already_set> failure_;  // touched with the interpreter's lock
};

}  // namespace raysfm::python
