#include "synth_output.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>

#include "raysfm/camera_files/camera_file.h"
#include "raysfm/files/atomic_file.h"
#include "raysfm/frames/image_writer.h"
#include "raysfm/results/trajectory_file.h"

namespace raysfm::app {
namespace {

namespace fs = std::filesystem;

// Larger composite images are refused.
constexpr int kMaxSide = 32768;

bool has_roi(const Camera& camera) {
  return camera.roi.w > 0;
}

// The rig as it is written beside its images. Masks are made anew.
Rig with_streams(Rig rig) {
  const bool composite = std::any_of(rig.cameras.begin(), rig.cameras.end(), has_roi);
  for (size_t i = 0; i < rig.cameras.size(); ++i) {
    rig.cameras[i].mask_path.clear();
    if (!composite) rig.cameras[i].stream = static_cast<int>(i);
  }
  return rig;
}

Result<std::vector<SynthStream>> streams_of(const Rig& rig) {
  std::vector<SynthStream> streams;
  for (size_t i = 0; i < rig.cameras.size(); ++i) {
    const Camera& camera = rig.cameras[i];
    const size_t number = static_cast<size_t>(camera.stream);
    if (number >= rig.cameras.size()) {
      return bad_input(fmt::format("camera {}: stream: {} is not allowed, 0 to {} are", camera.name, number,
                                   rig.cameras.size() - 1));
    }
    if (number >= streams.size()) streams.resize(number + 1);
    SynthStream& stream = streams[number];
    stream.cameras.push_back(i);
    stream.width = std::max(stream.width, camera.roi.x + camera.width);
    stream.height = std::max(stream.height, camera.roi.y + camera.height);
    if (stream.width > kMaxSide || stream.height > kMaxSide) {
      return bad_input(fmt::format("camera {}: roi: reaches to {}, {}; at most {} is allowed", camera.name,
                                   stream.width, stream.height, kMaxSide));
    }
  }
  for (size_t s = 0; s < streams.size(); ++s) {
    if (streams[s].cameras.empty()) return bad_input(fmt::format("camera file: no camera has stream {}", s));
    if (streams[s].cameras.size() == 1) continue;
    for (const size_t i : streams[s].cameras) {
      if (!has_roi(rig.cameras[i])) {
        return bad_input(fmt::format("camera {}: roi: missing, each camera of stream {} must have one",
                                     rig.cameras[i].name, s));
      }
    }
  }
  return streams;
}

// Images of another sequence among ours would not fit to times.txt.
Result<void> create_empty_folder(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return bad_input(fmt::format("{}: cannot be created: {}", folder.string(), error.message()));
  if (!fs::is_empty(folder, error) || error) {
    return bad_input(
        fmt::format("--out: {} is not empty, a new or empty folder is allowed", folder.string()));
  }
  return {};
}

std::string landmark_text(const synth::World& world) {
  std::string text = "id,x,y,z\n";
  for (size_t i = 0; i < world.landmarks.size(); ++i) {
    const Eigen::Vector3d& x = world.landmarks[i];
    text += fmt::format("{},{:.9f},{:.9f},{:.9f}\n", i, x.x(), x.y(), x.z());
  }
  return text;
}

}  // namespace

Result<SynthOutput> SynthOutput::create(Rig rig, const fs::path& folder) {
  SynthOutput output;
  output.folder_ = folder;
  output.rig_ = with_streams(std::move(rig));
  Result<std::vector<SynthStream>> streams = streams_of(output.rig_);
  if (!streams) return streams.error();
  output.streams_ = *std::move(streams);
  for (size_t i = 0; i < output.streams_.size(); ++i) {
    SynthStream& stream = output.streams_[i];
    stream.folder = folder / (output.streams_.size() == 1 ? "images" : fmt::format("cam{}", i));
    if (auto r = create_empty_folder(stream.folder); !r) return r.error();
  }
  return output;
}

Image<uint8_t> SynthOutput::render(synth::Sequence& sequence, int frame, const SynthStream& stream) const {
  if (stream.cameras.size() == 1 && !has_roi(rig_.cameras[stream.cameras[0]])) {
    return sequence.render(frame, static_cast<int>(stream.cameras[0]));
  }
  Image<uint8_t> image(3 * stream.width, stream.height);
  for (int y = 0; y < image.height(); ++y) std::memset(image.row(y), 0, static_cast<size_t>(image.width()));
  for (const size_t number : stream.cameras) {
    const Image<uint8_t> part = sequence.render(frame, static_cast<int>(number));
    const Roi& roi = rig_.cameras[number].roi;
    for (int y = 0; y < part.height(); ++y) {
      std::memcpy(image.row(roi.y + y) + 3 * roi.x, part.row(y), static_cast<size_t>(part.width()));
    }
  }
  return image;
}

// lens.csv, or lens0.csv, lens1.csv, ... where there are several cameras.
Result<void> SynthOutput::write_lens(const synth::Sequence& sequence, int frames) const {
  for (size_t c = 0; c < rig_.cameras.size(); ++c) {
    std::string text = "timestamp,fx,fy,cx,cy,skew\n";
    for (int i = 0; i < frames; ++i) {
      const synth::Lens lens = *synth::lens_of(sequence.camera(i, static_cast<int>(c)));
      text += fmt::format("{:.9f},{:.9g},{:.9g},{:.9g},{:.9g},0\n", sequence.timestamp(i), lens.fx, lens.fy,
                          lens.cx, lens.cy);
    }
    const std::string name = rig_.cameras.size() == 1 ? "lens.csv" : fmt::format("lens{}.csv", c);
    if (auto r = write_file(folder_ / name, text); !r) return r;
  }
  return {};
}

// mask.png, or mask0.png, mask1.png, ... where there are several cameras; none for a camera all of whose
// pixels see the world.
Result<void> SynthOutput::write_masks(const synth::Sequence& sequence) {
  for (size_t c = 0; c < rig_.cameras.size(); ++c) {
    const GrayImage mask = sequence.mask(static_cast<int>(c));
    bool whole = true;
    for (int y = 0; y < mask.height() && whole; ++y) {
      whole = std::all_of(mask.row(y), mask.row(y) + mask.width(), [](uint8_t m) { return m != 0; });
    }
    if (whole) continue;
    rig_.cameras[c].mask_path = rig_.cameras.size() == 1 ? "mask.png" : fmt::format("mask{}.png", c);
    if (auto r = write_png(folder_ / rig_.cameras[c].mask_path, mask.view()); !r) return r;
  }
  return {};
}

Result<void> SynthOutput::write_rest(const synth::Sequence& sequence, int frames, const std::string& config) {
  Trajectory truth;
  std::string times;
  for (int i = 0; i < frames; ++i) {
    truth.timestamps.push_back(sequence.timestamp(i));
    truth.world_from_cam.push_back(sequence.world_from_rig(i));
    times += fmt::format("{:.9f}\n", sequence.timestamp(i));
  }
  const synth::SequenceOptions& o = sequence.options();
  const std::string header =
      fmt::format("exact poses of world {}, motion {}, seed {}; metres, world from {}", o.world, o.motion,
                  o.seed, rig_.cameras.size() == 1 ? "camera" : "rig");
  if (auto r = write_file(folder_ / "times.txt", times); !r) return r;
  if (auto r = write_trajectory(truth, header, folder_ / "truth.txt"); !r) return r;
  if (!sequence.world().landmarks.empty()) {
    if (auto r = write_file(folder_ / "landmarks.csv", landmark_text(sequence.world())); !r) return r;
  }
  if (auto r = write_file(folder_ / "synth.yaml", config); !r) return r;
  // A camera file would be wrong for all frames of a zoom but one.
  if (sequence.zooms()) return write_lens(sequence, frames);
  if (auto r = write_masks(sequence); !r) return r;
  return write_camera_file(rig_, folder_ / "camera.yaml");
}

}  // namespace raysfm::app
