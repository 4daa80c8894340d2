#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "raysfm/camera/camera.h"
#include "raysfm/core/result.h"
#include "raysfm/core/time_range.h"
#include "raysfm/image/color_planes.h"
#include "raysfm/image/image.h"

namespace raysfm {

struct InputFrame {
  int index = 0;               // 0, 1, 2, ... in its stream
  double timestamp = 0;        // seconds: from the container or the layout, else index / fps, else index
  std::string name;            // file name without folders, or "frame-000012" for a video
  std::filesystem::path file;  // of an image; empty for a video
  GrayImage gray;
  ColorPlanes colors;
  // Why there is no image, or none of the size of the stream: one line that names the file. Empty: there is.
  std::string defect;
};

// One stream of frames. All frames of a stream without a defect have one size, that of the first such. An
// object may be handed from thread to thread, but only one may call it at a time.
class FrameSource {
 public:
  virtual ~FrameSource() = default;

  // The next frame; nullopt at the end. After an error the stream is at its end.
  virtual Result<std::optional<InputFrame>> next() = 0;

  // Size of all frames, known from the start; pixels.
  virtual int width() const = 0;
  virtual int height() const = 0;

  // Width of a pixel over its height, as far as the input says it.
  virtual double pixel_aspect() const { return 1; }

  // Number of frames, -1 where only reading to the end would tell. A video's count is what its container
  // says.
  virtual int frame_count() const = 0;

  // Timestamps of the first and, as well as that is known without reading, of the last frame; 0 where it is
  // not.
  virtual TimeRange span() const { return {}; }

  // Before the first next(): only the frames of some seconds come, counted from 0. What is before is not
  // decoded where that can be avoided. Errors: bad input, where there is no such frame.
  virtual Result<void> cut(const TimeRange&) {
    return bad_input(description() + ": has no times to begin or end at");
  }

  // From now on a frame may have another size than the first. Streams that cannot have it stay as they are.
  virtual void allow_any_size() {}

  // One line for the user, e.g. "video.mp4: h264, 640x480, 30 frames/s".
  virtual std::string description() const = 0;

  // What the user should know about the stream though it is no error, e.g. that a video is cut short. Empty:
  // nothing. Complete once next() has returned nullopt.
  virtual std::string note() const { return {}; }
};

struct InputOptions {
  double fps = 0;  // frames per second of inputs without timestamps, and of videos when given; 0: not given
  bool mono = false;                // the first camera only of a layout that has several
  bool ignore_calibration = false;  // do not read the camera file that lies beside the images
  int threads = 0;                  // of the decoder of a video; 0: as many as the machine has
  TimeRange range = {};             // the part that is read
};

// Everything that the inputs of the command line hold.
struct Input {
  std::vector<std::unique_ptr<FrameSource>> streams;      // at least one
  std::optional<Rig> calibration;                         // found beside the images, fits the streams
  std::optional<std::filesystem::path> calibration_file;  // where; set also when it is ignored
  // Of the first input: "video", "images", "sequence", "kitti", "euroc", "tum-rgbd" or "device".
  std::string layout;
  std::optional<std::filesystem::path> truth;  // trajectory found beside the images
  std::optional<std::filesystem::path> mask;   // mask.png found beside the images
  bool times_are_indices = false;  // timestamps count frames: nothing tells how far apart they are
};

// The rig for streams that are open: sizes that the camera file did not say are taken from the streams. With
// `mono`, cameras whose stream is not there are left out, of which `note` tells (e.g. the right one of a
// stereo pair). Errors: bad input, where the stream of a camera is missing, the size of a camera is not that
// of its stream, a roi is not inside it, or a stream has no camera.
Result<Rig> rig_for_streams(Rig rig, const std::vector<std::unique_ptr<FrameSource>>& streams,
                            std::string* note, bool mono = false);

// Bad input for what is no number of frames per second; 0 stands for an unknown one.
Result<void> check_fps(double fps);

// Opens a video file, an image folder or pattern (*, ?, or printf's %04d), a sequence folder in the project's
// layout, a KITTI odometry, EuRoC or TUM RGB-D folder, or a video device (/dev/videoN). Several inputs are
// the streams of a rig, in their order; those that are images have one number of them. Errors: bad input,
// naming the file and what is wrong with it.
Result<Input> open_input(const std::vector<std::string>& inputs, const InputOptions& options);

}  // namespace raysfm
