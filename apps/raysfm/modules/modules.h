#pragma once

// What the program loads when it is needed, and not with every start: OpenCV and FFmpeg bring some three
// hundred shared libraries. Each module exports one table of functions of the library.

#include "raysfm/frames/image_writer.h"
#include "raysfm/frames/other_image.h"
#include "raysfm/frames/video_source.h"
#include "raysfm/matching/board_corners.h"
#include "raysfm/matching/photo_features.h"
#include "raysfm/plots/board_plot.h"
#include "raysfm/plots/camera_plot.h"
#include "raysfm/plots/lens_plot.h"
#include "raysfm/plots/plot.h"

namespace raysfm::app {

struct PictureModule {
  static constexpr const char* kFile = "raysfm-pictures.so";
  static constexpr const char* kSymbol = "raysfm_picture_module";
  decltype(&raysfm::decode_other) decode_other;
  decltype(&raysfm::write_png) write_png;
  decltype(&raysfm::write_color_png) write_color_png;
  decltype(&raysfm::plot_cameras) plot_cameras;
  decltype(&raysfm::plot_lens) plot_lens;
  decltype(&raysfm::plot_evaluation) plot_evaluation;
  decltype(&raysfm::make_photo_features) make_photo_features;
  decltype(&raysfm::find_board_corners) find_board_corners;
  decltype(&raysfm::guess_board_size) guess_board_size;
  decltype(&raysfm::plot_boards) plot_boards;
};

struct VideoModule {
  static constexpr const char* kFile = "raysfm-video.so";
  static constexpr const char* kSymbol = "raysfm_video_module";
  decltype(&raysfm::open_video) open_video;
  decltype(&raysfm::open_device) open_device;
};

struct DeviceModule {
  static constexpr const char* kFile = "raysfm-devices.so";
  static constexpr const char* kSymbol = "raysfm_device_module";
  decltype(&raysfm::register_devices) register_devices;
};

}  // namespace raysfm::app
