#include <fmt/format.h>
#include <unistd.h>

#include <atomic>
#include <csignal>
#include <cstdio>
#include <deque>
#include <filesystem>
#include <future>
#include <memory>
#include <thread>

#include "commands.h"
#include "raysfm/core/timer.h"
#include "raysfm/io/atomic_file.h"
#include "raysfm/io/camera_file.h"
#include "raysfm/io/image_writer.h"
#include "raysfm/io/trajectory_file.h"
#include "raysfm/synth/motion.h"
#include "raysfm/synth/sequence.h"
#include "raysfm/synth/world.h"

namespace raysfm::app {
namespace {

namespace fs = std::filesystem;

volatile std::sig_atomic_t received_signal = 0;

void on_signal(int signal) {
  received_signal = signal;
}

struct Arguments {
  synth::SequenceOptions sequence;
  std::string out, camera;
  bool list = false;
};

void print_list() {
  std::puts("worlds:");
  for (const auto& w : synth::world_list()) {
    std::fputs(fmt::format("  {:<10} {}; drive of {:g} m\n", w.name, w.description, w.usual_length).c_str(),
               stdout);
  }
  std::puts("motions:");
  for (const auto& m : synth::motion_list()) {
    std::fputs(fmt::format("  {:<10} {}\n", m.name, m.description).c_str(), stdout);
  }
}

// Where the images of a rig's cameras go: images/, or cam0/, cam1/, ...
fs::path image_folder(const fs::path& out, size_t cameras, size_t camera) {
  return out / (cameras == 1 ? "images" : fmt::format("cam{}", camera));
}

// The folders, empty: images of another sequence among ours would not fit to times.txt.
Result<void> prepare_folders(const fs::path& out, size_t cameras) {
  std::error_code error;
  for (size_t i = 0; i < cameras; ++i) {
    const fs::path folder = image_folder(out, cameras, i);
    fs::create_directories(folder, error);
    if (error) return bad_input(fmt::format("{}: cannot be created: {}", folder.string(), error.message()));
    if (!fs::is_empty(folder, error) || error) {
      return bad_input(
          fmt::format("--out: {} is not empty, a new or empty folder is allowed", folder.string()));
    }
  }
  return {};
}

// The rig as it is written beside its images: every camera has a stream of its own, seen whole.
Rig with_own_streams(Rig rig) {
  for (size_t i = 0; i < rig.cameras.size(); ++i) {
    rig.cameras[i].stream = static_cast<int>(i);
    rig.cameras[i].roi = {};
    rig.cameras[i].mask_path.clear();
  }
  return rig;
}

// lens.csv, or lens0.csv, lens1.csv, ... where there are several cameras.
Result<void> write_lens(const synth::Sequence& sequence, const Rig& rig, int frames, const fs::path& out) {
  for (size_t c = 0; c < rig.cameras.size(); ++c) {
    std::string text = "timestamp,fx,fy,cx,cy,skew\n";
    for (int i = 0; i < frames; ++i) {
      const synth::Lens lens = *synth::lens_of(sequence.camera(i, static_cast<int>(c)));
      text += fmt::format("{:.9f},{:.9g},{:.9g},{:.9g},{:.9g},0\n", sequence.timestamp(i), lens.fx, lens.fy,
                          lens.cx, lens.cy);
    }
    const std::string name = rig.cameras.size() == 1 ? "lens.csv" : fmt::format("lens{}.csv", c);
    if (auto r = write_file(out / name, text); !r) return r;
  }
  return {};
}

// Everything beside the images, for the first `frames` frames.
Result<void> write_truth(const synth::Sequence& sequence, const Rig& rig, int frames, const fs::path& out) {
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
                  o.seed, rig.cameras.size() == 1 ? "camera" : "rig");
  if (auto r = write_file(out / "times.txt", times); !r) return r;
  if (auto r = write_trajectory(truth, header, out / "truth.txt"); !r) return r;
  // A camera file would be wrong for all frames of a zoom but one.
  return sequence.zooms() ? write_lens(sequence, rig, frames, out)
                          : write_camera_file(rig, out / "camera.yaml");
}

class Progress {
 public:
  Progress(bool quiet, int total) : quiet_(quiet), terminal_(isatty(STDERR_FILENO) != 0), total_(total) {}
  ~Progress() {
    if (!quiet_ && terminal_) std::fputc('\n', stderr);
  }
  void show(int frames) {
    if (quiet_ || (!terminal_ && frames % 100 != 0)) return;
    std::fprintf(stderr, "%sframe %d/%d%s", terminal_ ? "\r" : "", frames, total_,
                 terminal_ ? "\033[K" : "\n");
  }

 private:
  bool quiet_, terminal_;
  int total_;
};

// Renders until the end or a signal; images are compressed while the next ones are rendered. The value is the
// number of frames written whole.
Result<int> render_all(synth::Sequence& sequence, size_t cameras, const fs::path& out, bool quiet,
                       ThreadPool& pool) {
  Progress progress(quiet, sequence.frames());
  std::deque<std::future<Result<void>>> writing;
  const auto wait_for_one = [&]() -> Result<void> {
    Result<void> result = writing.front().get();
    writing.pop_front();
    return result;
  };
  const size_t most = 2 * (static_cast<size_t>(pool.workers()) + 1);
  Result<void> failure;
  int frame = 0;
  for (; frame < sequence.frames() && !received_signal && failure; ++frame) {
    for (size_t c = 0; c < cameras; ++c) {
      auto image = std::make_shared<Image<uint8_t>>(sequence.render(frame, static_cast<int>(c)));
      const fs::path path = image_folder(out, cameras, c) / fmt::format("{:06d}.png", frame);
      writing.push_back(pool.submit([image, path] { return write_color_png(path, image->view()); }));
    }
    while (writing.size() > most && failure) failure = wait_for_one();
    progress.show(frame + 1);
  }
  while (!writing.empty()) {
    const Result<void> result = wait_for_one();
    if (failure) failure = result;
  }
  if (!failure) return failure.error();
  return frame;
}

Result<int> run(Arguments& arguments, const CommonOptions& common) {
  if (arguments.list) {
    print_list();
    return 0;
  }
  if (arguments.sequence.world.empty()) return bad_input("WORLD is missing; --list names them");
  if (arguments.out.empty()) return bad_input("--out is missing; it names the folder to write to");
  if (!common.config.empty()) return bad_input("--config is not allowed here, flags are");
  arguments.sequence.seed = common.seed;
  Rig rig{{synth::default_camera()}};
  if (!arguments.camera.empty()) {
    Result<Rig> read = read_camera_file(arguments.camera);
    if (!read) return read.error();
    rig = with_own_streams(*std::move(read));
  }
  const unsigned threads = common.threads > 0 ? static_cast<unsigned>(common.threads)
                                              : std::max(1u, std::thread::hardware_concurrency());
  ThreadPool pool(static_cast<int>(threads) - 1);
  std::signal(SIGINT, on_signal);
  std::signal(SIGTERM, on_signal);

  auto sequence = synth::Sequence::create(arguments.sequence, rig, pool);
  if (!sequence) return sequence.error();
  if (auto r = prepare_folders(arguments.out, rig.cameras.size()); !r) return r.error();
  const Clock::time_point start = Clock::now();
  Result<int> frames = render_all(**sequence, rig.cameras.size(), arguments.out, common.quiet, pool);
  if (!frames) return frames.error();
  if (auto r = write_truth(**sequence, rig, *frames, arguments.out); !r) return r.error();
  if (!common.quiet) {
    const double seconds = milliseconds_since(start) / 1e3;
    std::printf("%d frames in %.1f s; written to %s\n", *frames, seconds, arguments.out.c_str());
  }
  return received_signal ? 128 + received_signal : 0;
}

}  // namespace

Command add_synth(CLI::App& program, const CommonOptions& common) {
  auto arguments = std::make_shared<Arguments>();
  CLI::App* command = program.add_subcommand("synth", "render a sequence with exact truth");
  synth::SequenceOptions& o = arguments->sequence;
  command->add_option("WORLD", o.world, "what to film; --list names them");
  command->add_option("--out", arguments->out, "folder to write: images, times.txt, truth.txt, camera.yaml");
  command->add_option("--camera", arguments->camera,
                      "camera file; default: 512 x 384 pinhole, 64 degrees wide");
  command->add_option("--motion", o.motion, "how the camera moves; default: the world's own");
  command->add_option("--frames", o.frames, "number of frames")->check(CLI::Range(1, 1000000));
  command->add_option("--fps", o.fps, "frames per second")->check(CLI::PositiveNumber);
  command->add_option("--length", o.length, "metres of motion drive")->check(CLI::PositiveNumber);
  command
      ->add_option("--zoom", o.zoom,
                   "factor by which the focal length grows over the sequence; writes lens.csv")
      ->capture_default_str();
  command->add_option("--noise", o.render.noise, "standard deviation of the noise, grey levels")
      ->capture_default_str();
  command->add_option("--blur", o.render.shutter, "seconds the shutter stays open")->capture_default_str();
  command->add_option("--samples", o.render.samples, "rays per pixel: 1, 4, 9 or 16")->capture_default_str();
  command->add_flag("--list", arguments->list, "list worlds and motions");
  return [arguments, &common] { return run(*arguments, common); };
}

}  // namespace raysfm::app
