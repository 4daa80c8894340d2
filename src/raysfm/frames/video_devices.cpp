extern "C" {
#include <libavdevice/avdevice.h>
}

#include "raysfm/frames/video_source.h"

namespace raysfm {

Result<void> register_devices() {
  avdevice_register_all();
  return {};
}

}  // namespace raysfm
