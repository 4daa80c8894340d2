#include <cstdio>
#include <cstring>
#include <string>
#include <vector>

#include "raysfm/api/track.h"
#include "raysfm/eval/trajectory_error.h"
#include "raysfm/frames/frame_set.h"
#include "raysfm/odometry/tracker.h"

namespace {

int fail(const std::string& what) {
  std::fprintf(stderr, "consume: %s\n", what.c_str());
  return 1;
}

// The lowest and the highest floor of the installed library: a path evaluated against itself, and a video
// that does not exist, which must be refused with a message.
int use_both_ends() {
  raysfm::Trajectory path;
  for (int i = 0; i < 10; ++i) {
    path.timestamps.push_back(i);
    path.world_from_cam.push_back({Eigen::Quaterniond::Identity(), {1.0 * i, 0.5 * i * i, 0}});
  }
  const auto evaluation = raysfm::evaluate(path, path, {});
  if (!evaluation || evaluation->ate.max > 1e-9) return fail("a path is not itself");
  raysfm::TrackSettings settings;
  settings.inputs = {"no such video"};
  const auto result = raysfm::track(settings, {});
  if (result.ok() || result.error().kind != raysfm::ErrorKind::kBadInput) return fail("no video is no error");
  std::printf("refused as it should be: %s\n", result.error().message.c_str());
  return 0;
}

raysfm::PixelView pixels_of(const raysfm::InputFrame& frame) {
  const raysfm::Image<uint8_t>& rgb = frame.colors.rgb;
  if (rgb.empty()) {
    return {frame.gray.row(0), frame.gray.width(), frame.gray.height(), frame.gray.view().stride};
  }
  const auto format =
      frame.colors.values_per_pixel == 3 ? raysfm::PixelFormat::kRgb : raysfm::PixelFormat::kRgba;
  return {rgb.row(0), frame.gray.width(), frame.gray.height(), rgb.view().stride, format};
}

// Pushes the frames of a sequence one by one, and tracks it as a whole: the same poses, byte for byte.
int push_frames(const std::string& folder) {
  const auto input = raysfm::open_input({folder}, {});
  if (!input || !input->calibration) return fail(folder + " is no sequence");
  const auto tracker = raysfm::Tracker::create(*input->calibration, {});
  if (!tracker) return fail(tracker.error().message);
  raysfm::FrameSetReader reader(input->streams);
  int at_once = 0;
  for (;;) {
    const auto frames = reader.next();
    if (!frames) return fail(frames.error().message);
    if (frames->empty()) break;
    std::vector<raysfm::PixelView> images;
    for (const raysfm::InputFrame& frame : *frames) images.push_back(pixels_of(frame));
    const auto pushed = (*tracker)->push(images, frames->front().timestamp, frames->front().name);
    if (!pushed) return fail(pushed.error().message);
    at_once += pushed->pose.has_value();
  }
  const raysfm::Reconstruction one_by_one = (*tracker)->finish(false);

  raysfm::TrackSettings settings;
  settings.inputs = {folder};
  const auto whole = raysfm::track(settings, {});
  if (!whole) return fail(whole.error().message);
  const auto& expected = whole->reconstruction.frames;
  if (expected.size() != one_by_one.frames.size()) return fail("another number of frames");
  for (size_t i = 0; i < expected.size(); ++i) {
    const auto &a = expected[i].world_from_rig, &b = one_by_one.frames[i].world_from_rig;
    if (!a || !b) return fail("frame " + std::to_string(i) + " is not posed");
    if (std::memcmp(a->rotation.coeffs().data(), b->rotation.coeffs().data(), 4 * sizeof(double)) != 0 ||
        std::memcmp(a->translation.data(), b->translation.data(), 3 * sizeof(double)) != 0) {
      return fail("frame " + std::to_string(i) + " has another pose");
    }
  }
  std::printf("%zu frames pushed, %d posed at once, all poses as track has them\n", expected.size(), at_once);
  return at_once > 0 ? 0 : fail("no frame was posed at once");
}

}  // namespace

// consume FOLDER: the installed library as a user's program sees it, on a sequence.
int main(int argc, char** argv) {
  if (argc != 2) return fail("one argument is needed, a sequence");
  if (const int code = use_both_ends(); code != 0) return code;
  return push_frames(argv[1]);
}
