#include "modules.h"

namespace {

// The program says itself what is wrong with a video.
[[maybe_unused]] const bool silent = (raysfm::silence_ffmpeg(), true);

}  // namespace

extern "C" const raysfm::app::VideoModule raysfm_video_module = {raysfm::open_video, raysfm::open_device};
