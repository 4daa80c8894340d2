// track_webcam CAMERA.yaml [VIDEO]: prints the pose of each frame of the webcam, or of a video, as it comes.
#include <chrono>
#include <cstdio>
#include <opencv2/videoio.hpp>
#include <utility>

#include "raysfm/api/track.h"
#include "raysfm/camera_files/camera_file.h"
#include "raysfm/odometry/tracker.h"

int main(int argc, char** argv) {
  if (argc < 2) return std::fprintf(stderr, "usage: track_webcam CAMERA.yaml [VIDEO]\n"), 2;
  auto rig = raysfm::read_camera_file(argv[1]);
  if (!rig) return std::fprintf(stderr, "%s\n", rig.error().message.c_str()), 2;
  raysfm::TrackerOptions options;
  if (!raysfm::set_rolling_shutter("auto", &*rig, &options.odometry.calibration_prior)) return 2;
  const auto tracker = raysfm::Tracker::create(*rig, std::move(options));
  if (!tracker) return std::fprintf(stderr, "%s\n", tracker.error().message.c_str()), 2;

  cv::VideoCapture video;
  if (!(argc > 2 ? video.open(argv[2]) : video.open(0))) return std::fprintf(stderr, "no video\n"), 2;
  const auto start = std::chrono::steady_clock::now();
  cv::Mat image;
  for (int i = 0; video.read(image); ++i) {
    const std::chrono::duration<double> now = std::chrono::steady_clock::now() - start;
    const raysfm::PixelView pixels{image.data, image.cols, image.rows, static_cast<ptrdiff_t>(image.step),
                                   raysfm::PixelFormat::kBgr};
    const auto frame = (*tracker)->push({&pixels, 1}, argc > 2 ? i : now.count());
    if (!frame) return std::fprintf(stderr, "%s\n", frame.error().message.c_str()), 2;
    if (!frame->pose) {
      std::printf("%d %s\n", frame->frame, frame->reason.c_str());
      continue;
    }
    const Eigen::Vector3d at = frame->pose->world_from_rig.translation;
    std::printf("%d %.4f %.4f %.4f\n", frame->frame, at.x(), at.y(), at.z());
  }
  const raysfm::Reconstruction map = (*tracker)->finish(false);
  std::printf("%zu points, %zu key frames\n", map.points.size(), map.keyframes.size());
}
