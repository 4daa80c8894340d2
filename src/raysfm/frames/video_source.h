#pragma once

#include <memory>
#include <string>

#include "raysfm/frames/frame_source.h"

namespace raysfm {

struct DecoderOptions {
  double fps = 0;   // frames per second; 0: those of the container
  int threads = 0;  // of the decoder, which change no frame; 0: as many as the machine has
};

// Opens a video file that FFmpeg decodes. Timestamps are the container's presentation times; with fps > 0, or
// where the container has none, index / fps (of the container). A rotation in the metadata is ignored, and
// note() says so: calibrations are of the pixels as stored. A frame that is damaged or of another size than
// the first is one with a defect; a video that is cut short yields the frames that decode, and note() says so
// at the end. Errors: bad input, for what is no video or has no frame that decodes.
Result<std::unique_ptr<FrameSource>> open_video(const std::string& path, const DecoderOptions& options);

// The same for a capture device such as /dev/video0, through Video4Linux, after register_devices(). It has no
// end.
Result<std::unique_ptr<FrameSource>> open_device(const std::string& path, const DecoderOptions& options);

// Makes devices known to FFmpeg. Apart, as it brings 80 shared libraries, which files do without.
Result<void> register_devices();

// FFmpeg's own lines on stderr, in the whole process.
void silence_ffmpeg();

}  // namespace raysfm
