#pragma once

#include <vector>

#include "raysfm/views/view.h"

namespace raysfm {

// Where the image of one camera of a rig comes from, and what is looked for in it.
struct CameraInput {
  int stream = 0;        // of the pictures taken at one instant
  Roi roi;               // lies inside that picture; empty (w = 0): all of it
  HarrisOptions harris;  // the mask has the size of the camera's image or is empty
};

// A picture with the image of one camera, or of several.
struct Picture {
  GrayImage gray;
  ColorPlanes colors;
};

// Makes views of the pictures that a rig takes, in two steps: the second is dear, and a view that is only
// posed does without. A view depends on its pictures alone. Any number of threads may use it at a time.
class ViewMaker {
 public:
  // At least one camera. What the masks point to must outlive the maker.
  explicit ViewMaker(std::vector<CameraInput> cameras);

  // The first step: fills view->cameras, and adds its time to view->detect_ms. Element s of `pictures` is
  // that of stream s.
  void look(std::vector<Picture> pictures, View* view) const;

  // The second step, unless it is done.
  void detect(View* view) const;
  // The same for a view that others may see: itself, or one with corners beside.
  ViewPtr detected(const ViewPtr& view) const;
  // With other corners, of which no part of the image has many more than its share: where something moves
  // that has most of the strong ones. Each has the colour of the strongest ones' nearest, as detection lets
  // colours go.
  ViewPtr detected_evenly(const ViewPtr& view) const;

 private:
  void find_corners(bool evenly, View* view) const;

  std::vector<CameraInput> cameras_;
  std::vector<bool> owns_stream_;  // by camera: its image is the whole picture, and nobody else's
};

}  // namespace raysfm
