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
#include "raysfm/camera_files/camera_file.h"
#include "raysfm/core/timer.h"
#include "raysfm/frames/image_writer.h"
#include "raysfm/synth/motion.h"
#include "raysfm/synth/sequence.h"
#include "raysfm/worlds/world.h"
#include "setting_flags.h"
#include "synth_output.h"

namespace raysfm::app {
namespace {

namespace fs = std::filesystem;

volatile std::sig_atomic_t synth_signal = 0;

void on_synth_signal(int signal) {
  synth_signal = signal;
}

struct SynthArguments {
  synth::SequenceOptions sequence;
  int threads = 0;
  double readout = 0;  // milliseconds
  std::string out, camera;
  bool list = false;
};

std::vector<SettingField> setting_fields(SynthArguments& a) {
  synth::SequenceOptions& o = a.sequence;
  return {
      {"world", "what to film", &o.world, {}},
      {"camera", "camera file; default: 512 x 384 pinhole, 64 degrees wide", &a.camera, {}},
      {"motion", "how the camera moves; default: the world's own", &o.motion, {}},
      {"frames", "number of frames; default: the world's own", &o.frames, {}},
      {"fps", "frames per second; default: the world's own", &o.fps, {}},
      {"length",
       "metres of motion drive, walk, look and straight; default: at their usual speed",
       &o.length,
       {}},
      {"zoom", "factor by which the focal length grows over the sequence; writes lens.csv", &o.zoom, {}},
      {"rounds", "how often motion loop goes round its circuit", &o.rounds, {}},
      {"noise", "standard deviation of the noise, grey levels", &o.render.noise, {}},
      {"blur", "seconds the shutter stays open", &o.render.shutter, {}},
      {"readout", "milliseconds from the first row of an image to the last; 0: all at once", &a.readout, {}},
      {"samples", "rays per pixel: 1, 4, 9 or 16", &o.render.samples, {}},
      {"seed", "seed of every random choice", &o.seed, {}},
      {"threads", "worker threads; 0 for as many as the machine has", &a.threads, {}},
  };
}

void print_list() {
  std::puts("worlds:");
  for (const auto& w : synth::world_list()) {
    std::fputs(fmt::format("  {:<10} {}; way of {:g} m\n", w.name, w.description, w.usual_length).c_str(),
               stdout);
  }
  std::puts("motions:");
  for (const auto& m : synth::motion_list()) {
    std::fputs(fmt::format("  {:<10} {}\n", m.name, m.description).c_str(), stdout);
  }
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
Result<int> render_all(synth::Sequence& sequence, const SynthOutput& output, bool quiet, ThreadPool& pool) {
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
  for (; frame < sequence.frames() && !synth_signal && failure; ++frame) {
    for (const SynthStream& stream : output.streams()) {
      auto image = std::make_shared<Image<uint8_t>>(output.render(sequence, frame, stream));
      const fs::path path = stream.folder / fmt::format("{:06d}.png", frame);
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

// A configuration file names its camera file relative to itself.
void find_camera(SynthArguments& arguments, bool on_command_line, const std::string& config) {
  const fs::path camera = arguments.camera, beside = fs::path(config).parent_path() / camera;
  std::error_code missing;
  if (!on_command_line && camera.is_relative() && fs::is_regular_file(beside, missing)) {
    arguments.camera = beside.string();
  }
}

Result<Rig> read_synth_rig(const std::string& camera) {
  if (camera.empty()) return Rig{{synth::default_camera()}};
  return read_camera_file(camera);
}

Result<int> run_synth(SynthArguments& arguments, const CommonOptions& common) {
  if (arguments.list) {
    print_list();
    return 0;
  }
  if (arguments.sequence.world.empty()) return bad_input("WORLD is missing; --list names them");
  if (arguments.out.empty()) return bad_input("--out is missing; it names the folder to write to");
  Result<Rig> rig = read_synth_rig(arguments.camera);
  if (!rig) return rig.error();
  const unsigned threads = arguments.threads > 0 ? static_cast<unsigned>(arguments.threads)
                                                 : std::max(1u, std::thread::hardware_concurrency());
  ThreadPool pool(static_cast<int>(threads) - 1);
  std::signal(SIGINT, on_synth_signal);
  std::signal(SIGTERM, on_synth_signal);

  arguments.sequence.render.readout = arguments.readout / 1000;
  auto sequence = synth::Sequence::create(arguments.sequence, *rig, pool);
  if (!sequence) return sequence.error();
  for (Camera& camera : rig->cameras) camera.shutter = {arguments.sequence.render.readout};
  Result<SynthOutput> output = SynthOutput::create(*std::move(rig), arguments.out);
  if (!output) return output.error();
  const Clock::time_point start = Clock::now();
  const Result<int> frames = render_all(**sequence, *output, common.quiet, pool);
  if (!frames) return frames.error();
  arguments.sequence = (*sequence)->options();
  if (!arguments.camera.empty()) arguments.camera = fs::absolute(arguments.camera).string();
  const std::string config = effective_config(setting_fields(arguments), {}, RAYSFM_VERSION);
  if (auto r = output->write_rest(**sequence, *frames, config); !r) return r.error();
  if (!common.quiet) {
    const double seconds = milliseconds_since(start) / 1e3;
    std::printf("%d frames in %.1f s; written to %s\n", *frames, seconds, arguments.out.c_str());
  }
  return synth_signal ? 128 + synth_signal : 0;
}

}  // namespace

Command add_synth(CLI::App& program, const CommonOptions& common) {
  auto arguments = std::make_shared<SynthArguments>();
  CLI::App* command = program.add_subcommand("synth", "render a sequence with exact truth");
  std::vector<SettingField> flags = setting_fields(*arguments);
  command->add_option("--world,WORLD", arguments->sequence.world, flags.front().help + "; --list names them");
  flags.erase(flags.begin());
  command->add_option("--out", arguments->out, "folder to write: images, times.txt, truth.txt, camera.yaml");
  add_setting_flags(*command, flags);
  command->add_flag("--list", arguments->list, "list worlds and motions");
  return [arguments, command, &program, &common]() -> Result<int> {
    const Result<ConfigRecord> config =
        settle_settings(setting_fields(*arguments), *command, program, common);
    if (!config) return config.error();
    find_camera(*arguments, command->count("--camera") > 0, common.config);
    Result<int> code = run_synth(*arguments, common);
    if (!code) return where_it_was_set(code.error(), *config);
    return code;
  };
}

}  // namespace raysfm::app
