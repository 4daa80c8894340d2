#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "raysfm/synth/sequence.h"
#include "raysfm/views/view.h"
#include "support/panel_world.h"

namespace raysfm::testing_support {

// A rendered sequence: what the camera sees and where it was.
struct SynthViews {
  std::vector<GrayImage> images;
  std::vector<Rigid3> world_from_rig;
  std::vector<double> timestamps;

  int size() const { return static_cast<int>(images.size()); }
  ViewPtr view(int i, int frame, double seconds_per_frame = 0.1) const {
    GrayImage image(images[i].width(), images[i].height());
    for (int y = 0; y < image.height(); ++y) std::copy_n(images[i].row(y), image.width(), image.row(y));
    return as_view(std::move(image), frame, 600, seconds_per_frame);
  }
};

// The first frames of a world; `readout` in seconds.
inline SynthViews synth_views(const std::string& world, const std::string& motion, int frames,
                              uint64_t seed = 0, double readout = 0, const Camera& camera = small_camera()) {
  ThreadPool pool(0);
  synth::SequenceOptions options;
  options.world = world;
  options.motion = motion;
  options.frames = frames;
  options.seed = seed;
  options.render.samples = 1;
  options.render.readout = readout;
  auto sequence = synth::Sequence::create(options, Rig{{camera}}, pool);
  SynthViews out;
  if (!sequence) {
    ADD_FAILURE() << sequence.error().message;
    return out;
  }
  for (int i = 0; i < frames; ++i) {
    out.images.push_back(synth::to_gray((*sequence)->render(i, 0)));
    out.world_from_rig.push_back((*sequence)->world_from_rig(i));
    out.timestamps.push_back((*sequence)->timestamp(i));
  }
  return out;
}

// The same with a label written over a corner of every image, from its first frame on.
inline SynthViews labelled(const SynthViews& views, int first = 0) {
  const Texture label(9, 5, 20, 50);
  SynthViews out{{}, views.world_from_rig, views.timestamps};
  for (int i = 0; i < views.size(); ++i) {
    GrayImage image(views.images[i].width(), views.images[i].height());
    for (int y = 0; y < image.height(); ++y) {
      std::copy_n(views.images[i].row(y), image.width(), image.row(y));
      for (int x = image.width() / 2; i >= first && y < image.height() / 3 && x < image.width(); ++x) {
        image.row(y)[x] = to_grey(label({x, y}));
      }
    }
    out.images.push_back(std::move(image));
  }
  return out;
}

// About 3 m along a corridor.
inline const SynthViews& corridor() {
  static const SynthViews views = synth_views("corridor", "drive", 30);
  return views;
}

}  // namespace raysfm::testing_support
