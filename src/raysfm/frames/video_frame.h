#pragma once

#include "raysfm/image/color_planes.h"
#include "raysfm/image/image.h"

struct AVFrame;
struct SwsContext;

namespace raysfm {

// Turns decoded frames into grey and colour images.
//
// Grey of a YUV frame is its luma, not a mix of converted colours: it is what the camera recorded and costs a
// copy. Luma of limited range (16 to 235, what most videos hold) is stretched to 0 to 255, of full range
// taken as it is; more than 8 bits are scaled to 8. Colours are its chroma. Grey of an RGB frame is 0.299 R +
// 0.587 G + 0.114 B.
class VideoFrameConverter {
 public:
  VideoFrameConverter() = default;
  ~VideoFrameConverter();
  VideoFrameConverter(const VideoFrameConverter&) = delete;
  VideoFrameConverter& operator=(const VideoFrameConverter&) = delete;

  // False where the format of the pixels cannot be converted. `colors` stay empty where the frame is grey.
  bool convert(const AVFrame& frame, GrayImage* gray, ColorPlanes* colors);

 private:
  SwsContext* scaler_ = nullptr;
};

}  // namespace raysfm
