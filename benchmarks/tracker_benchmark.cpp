// tracker_benchmark SEQUENCE [CAMERA.yaml] [--frames FILE.csv]: time and allocated bytes of each push() over
// a sequence, start included. --frames writes one line for each frame: its time, and whether a key frame came
// of it.
#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <new>
#include <string>
#include <vector>

#include "raysfm/camera_files/camera_file.h"
#include "raysfm/frames/frame_set.h"
#include "raysfm/odometry/tracker.h"

namespace {

std::atomic<size_t> allocated{0};

void* counted(size_t size, size_t alignment) {
  allocated += size;
  const size_t padded = (size + alignment - 1) / alignment * alignment;
  if (void* memory = std::aligned_alloc(alignment, padded)) return memory;
  throw std::bad_alloc();
}

}  // namespace

void* operator new(size_t size) {
  return counted(size, __STDCPP_DEFAULT_NEW_ALIGNMENT__);
}
void* operator new(size_t size, std::align_val_t alignment) {
  return counted(size, static_cast<size_t>(alignment));
}
void operator delete(void* memory) noexcept {
  std::free(memory);
}
void operator delete(void* memory, size_t) noexcept {
  std::free(memory);
}
void operator delete(void* memory, std::align_val_t) noexcept {
  std::free(memory);
}
void operator delete(void* memory, size_t, std::align_val_t) noexcept {
  std::free(memory);
}

namespace raysfm {
namespace {

struct Push {
  double ms = 0;
  double kib = 0;
  bool grew = false;  // a key frame, or a start
};

struct KeyFrames : TrackerObserver {
  int count = 0;
  void keyframe_added(const KeyFrameAdded&) override { ++count; }
};

double quantile(std::vector<double> values, double q) {
  if (values.empty()) return 0;
  std::ranges::sort(values);
  return values[static_cast<size_t>(q * static_cast<double>(values.size() - 1))];
}

PixelView pixels_of(const InputFrame& frame) {
  return {frame.gray.row(0), frame.gray.width(), frame.gray.height(), frame.gray.view().stride};
}

std::vector<Push> push_all(const Input& input, Tracker& tracker, const KeyFrames& heard) {
  std::vector<Push> pushes;
  FrameSetReader reader(input.streams);
  for (;;) {
    const Result<std::vector<InputFrame>> frames = reader.next();
    if (!frames || frames->empty()) return pushes;
    std::vector<PixelView> images;
    for (const InputFrame& frame : *frames) images.push_back(pixels_of(frame));
    const int keyframes = heard.count;
    const size_t before = allocated;
    const auto start = std::chrono::steady_clock::now();
    if (!tracker.push(images, frames->front().timestamp)) return pushes;
    const std::chrono::duration<double, std::milli> time = std::chrono::steady_clock::now() - start;
    pushes.push_back({time.count(), static_cast<double>(allocated - before) / 1024, heard.count > keyframes});
  }
}

void print(const std::vector<Push>& pushes) {
  std::vector<double> all, early, late;
  for (const Push& p : pushes) all.push_back(p.ms);
  for (size_t i = 0; i < pushes.size(); ++i) {
    if (!pushes[i].grew) (i < pushes.size() / 2 ? early : late).push_back(pushes[i].kib);
  }
  fmt::print("push of {} frames: median {:.2f} ms, 99 % {:.2f} ms, longest {:.2f} ms\n", pushes.size(),
             quantile(all, 0.5), quantile(all, 0.99), quantile(all, 1));
  fmt::print(
      "allocated by frames that are no key frames: median {:.0f} KiB in the first half, {:.0f} in the "
      "second\n",
      quantile(early, 0.5), quantile(late, 0.5));
}

bool write_frames(const std::vector<Push>& pushes, const std::string& path) {
  std::FILE* file = std::fopen(path.c_str(), "w");
  if (!file) return false;
  fmt::print(file, "frame,ms,keyframe\n");
  for (size_t i = 0; i < pushes.size(); ++i) {
    fmt::print(file, "{},{:.3f},{}\n", i, pushes[i].ms, int{pushes[i].grew});
  }
  return std::fclose(file) == 0;
}

int run(const std::string& sequence, const std::string& camera, const std::string& frames) {
  const auto input = open_input({sequence}, {});
  if (!input) return fmt::print(stderr, "{}\n", input.error().message), 2;
  if (camera.empty() && !input->calibration) return fmt::print(stderr, "{}: no camera\n", sequence), 2;
  const Result<Rig> rig = camera.empty() ? Result<Rig>(*input->calibration) : read_camera_file(camera);
  if (!rig) return fmt::print(stderr, "{}\n", rig.error().message), 2;
  KeyFrames heard;
  const auto tracker = Tracker::create(*rig, {}, &heard);
  if (!tracker) return fmt::print(stderr, "{}\n", tracker.error().message), 2;
  const std::vector<Push> pushes = push_all(*input, **tracker, heard);
  print(pushes);
  if (frames.empty() || write_frames(pushes, frames)) return 0;
  return fmt::print(stderr, "{}: cannot be written\n", frames), 1;
}

}  // namespace
}  // namespace raysfm

int main(int argc, char** argv) {
  std::vector<std::string> words(argv + 1, argv + argc);
  std::string frames;
  if (words.size() > 2 && words[words.size() - 2] == "--frames") {
    frames = words.back();
    words.resize(words.size() - 2);
  }
  if (words.empty() || words.size() > 2) {
    return fmt::print(stderr, "usage: tracker_benchmark SEQUENCE [CAMERA.yaml] [--frames FILE.csv]\n"), 2;
  }
  return raysfm::run(words[0], words.size() > 1 ? words[1] : "", frames);
}
