#pragma once

#include <memory>
#include <string>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/synth/renderer.h"
#include "raysfm/synth/zoom.h"

namespace raysfm::synth {

// What to film. Zero and empty stand for the world's habit.
struct SequenceOptions {
  std::string world;
  std::string motion;
  int frames = 0;     // at most 1000000
  double fps = 0;     // Hz, at most 10000
  double length = 0;  // metres of drive, walk, look and straight; else they go at their usual speed
  double zoom = 1;    // the focal length grows by this factor from the first frame to the last; [0.1, 10]
  double rounds = 1;  // of loop; above 0, at most 100
  uint64_t seed = 0;
  RenderOptions render;  // its seed is replaced by the one above
};

// The camera where none is given: 512 x 384 pixels, 64 degrees wide.
Camera default_camera();

// A rig that moves through a world: images and the exact pose of every frame. Frame i is at i / fps seconds.
class Sequence {
 public:
  // `pool` must outlive it. Errors: bad input, naming the option, its value and what is allowed.
  static Result<std::unique_ptr<Sequence>> create(SequenceOptions options, const Rig& rig, ThreadPool& pool);

  int frames() const { return options_.frames; }
  double timestamp(int frame) const { return static_cast<double>(frame) / options_.fps; }
  Rigid3 world_from_rig(int frame) const { return motion_(timestamp(frame)); }
  const World& world() const { return world_; }
  const SequenceOptions& options() const { return options_; }  // with the defaults filled in

  bool zooms() const { return options_.zoom != 1; }
  // The camera as it is at a frame: the given one but for its focal lengths.
  Camera camera(int frame, int number) const;

  // 255 where a pixel sees the world; see Renderer::mask. Of the camera that does not zoom.
  GrayImage mask(int camera) const { return renderers_[static_cast<size_t>(camera)].mask(); }

  // Blue, green, red interleaved; see Renderer::render.
  Image<uint8_t> render(int frame, int camera);

 private:
  Sequence(SequenceOptions options, const Rig& rig, World world, Motion motion)
      : options_(std::move(options)), rig_(rig), world_(std::move(world)), motion_(std::move(motion)) {}

  SequenceOptions options_;
  Rig rig_;
  World world_;
  Motion motion_;
  std::vector<Renderer> renderers_;
};

}  // namespace raysfm::synth
