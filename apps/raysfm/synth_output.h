#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "raysfm/synth/sequence.h"

namespace raysfm::app {

// One sequence of image files: what one camera sees, or several cameras side by side as their rois say.
struct SynthStream {
  std::filesystem::path folder;
  int width = 0, height = 0;    // pixels
  std::vector<size_t> cameras;  // of the rig
};

// The folder that a rendered sequence is written to, in the layout that `track` reads.
class SynthOutput {
 public:
  // Streams are those of the camera file where it has rois, else every camera has its own. Errors: bad input,
  // also where images of another sequence lie there.
  static Result<SynthOutput> create(Rig rig, const std::filesystem::path& folder);

  const Rig& rig() const { return rig_; }
  const std::vector<SynthStream>& streams() const { return streams_; }

  // The image of a stream at a frame. Blue, green, red interleaved.
  Image<uint8_t> render(synth::Sequence& sequence, int frame, const SynthStream& stream) const;

  // Everything beside the images, for the first `frames` frames: times.txt, truth.txt, camera.yaml or
  // lens.csv, masks, landmarks.csv, synth.yaml with the text `config`.
  Result<void> write_rest(const synth::Sequence& sequence, int frames, const std::string& config);

 private:
  Result<void> write_lens(const synth::Sequence& sequence, int frames) const;
  Result<void> write_masks(const synth::Sequence& sequence);

  std::filesystem::path folder_;
  Rig rig_;
  std::vector<SynthStream> streams_;
};

}  // namespace raysfm::app
