#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "raysfm/odometry/view.h"
#include "raysfm/synth/sequence.h"
#include "support/panel_world.h"

namespace raysfm::testing_support {

// A rendered sequence: what the camera sees and where it was.
struct SynthViews {
  std::vector<ViewPtr> views;
  std::vector<Rigid3> world_from_rig;
};

// The first frames of a world through small_camera(). `first_frame` numbers the first view, so that several
// sequences can follow one another.
inline SynthViews synth_views(const std::string& world, const std::string& motion, int frames,
                              uint64_t seed = 0) {
  ThreadPool pool(0);
  synth::SequenceOptions options;
  options.world = world;
  options.motion = motion;
  options.frames = frames;
  options.seed = seed;
  options.render.samples = 1;
  auto sequence = synth::Sequence::create(options, Rig{{small_camera()}}, pool);
  SynthViews out;
  if (!sequence) {
    ADD_FAILURE() << sequence.error().message;
    return out;
  }
  for (int i = 0; i < frames; ++i) {
    out.views.push_back(as_view(synth::to_gray((*sequence)->render(i, 0)), i));
    out.world_from_rig.push_back((*sequence)->world_from_rig(i));
  }
  return out;
}

// The same view as another frame.
inline ViewPtr renumbered(const ViewPtr& view, int frame) {
  GrayImage image(view->cameras[0].image.width(), view->cameras[0].image.height());
  for (int y = 0; y < image.height(); ++y)
    std::copy_n(view->cameras[0].image.row(y), image.width(), image.row(y));
  return as_view(std::move(image), frame);
}

}  // namespace raysfm::testing_support
