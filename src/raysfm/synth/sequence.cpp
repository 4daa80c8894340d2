#include "raysfm/synth/sequence.h"

#include <cmath>
#include <sstream>

namespace raysfm::synth {

namespace {

Error refused(const std::string& what, double value, const std::string& allowed) {
  std::ostringstream text;
  text << what << ": " << value << " is not allowed, " << allowed;
  return bad_input(text.str());
}

bool within(double value, double low, double high) {
  return value >= low && value <= high;
}

Result<void> check(const SequenceOptions& o) {
  if (o.frames < 0 || o.frames > 1000000) return refused("frames", o.frames, "1 to 1000000 are");
  if (!within(o.fps, 0, 10000)) return refused("fps", o.fps, "numbers above 0 up to 10000 are");
  const int samples = o.render.samples;
  if (samples != 1 && samples != 4 && samples != 9 && samples != 16) {
    return refused("samples", samples, "1, 4, 9 and 16 are");
  }
  if (!within(o.render.noise, 0, 100)) return refused("noise", o.render.noise, "0 to 100 grey levels are");
  if (!within(o.render.readout, 0, 10)) {
    return refused("readout", 1000 * o.render.readout, "0 to 10000 milliseconds are");
  }
  if (!within(o.render.shutter, 0, 10)) return refused("blur", o.render.shutter, "0 to 10 seconds are");
  if (!within(o.zoom, 0.1, 10)) return refused("zoom", o.zoom, "0.1 to 10 are");
  if (!(o.rounds > 0 && o.rounds <= 100)) return refused("rounds", o.rounds, "numbers above 0 up to 100 are");
  return {};
}

Result<void> check(const Rig& rig, const SequenceOptions& options) {
  if (rig.cameras.empty()) return bad_input("camera: a rig of no cameras is not allowed, at least one is");
  for (const Camera& camera : rig.cameras) {
    const std::string size = std::to_string(camera.width) + " x " + std::to_string(camera.height);
    if (camera.width <= 0 || camera.height <= 0) {
      return bad_input("camera " + camera.name + ": resolution: " + size +
                       " is not allowed, the camera file must name one to render with");
    }
    if (camera.width > 32768 || camera.height > 32768 || !fits_in_memory(camera, options.render.samples)) {
      return bad_input("camera " + camera.name + ": resolution: " + size + " with " +
                       std::to_string(options.render.samples) + " samples is not allowed, at most " +
                       std::to_string(kMaxGridPoints) + " rays are");
    }
  }
  for (const Camera& camera : rig.cameras) {
    if (options.zoom != 1 && !lens_of(camera)) {
      return bad_input("camera " + camera.name + ": model: " + std::string(model_name(camera.model)) +
                       " is not allowed with --zoom, models with fx, fy, cx and cy are");
    }
  }
  return {};
}

// Fills in what the world's habit says. A motion keeps its usual speed unless both its length and its number
// of frames are given.
void fill_in(SequenceOptions& o, const World& world, double usual_length) {
  constexpr double kWalkingSpeed = 0.8;  // metres per second
  const Habit& habit = world.habit;
  if (o.motion.empty()) o.motion = habit.motion;
  if (o.fps == 0) o.fps = habit.fps;
  const double usual_speed = o.motion == "walk" || o.motion == "look"
                                 ? kWalkingSpeed
                                 : usual_length * habit.fps / habit.frames;  // metres per second
  if (o.frames == 0) {
    const double rounds = o.motion == "loop" ? o.rounds : 1;
    const double seconds =
        o.length > 0 && has_length(o.motion) ? o.length / usual_speed : rounds * habit.frames / habit.fps;
    o.frames = std::max(1, static_cast<int>(std::lround(std::min(seconds * o.fps, 1e6))));
  }
  const double most = o.motion == "straight" ? world.stage.straight_length : world.length;
  if (o.length == 0) o.length = std::min(usual_speed * o.frames / o.fps, most);
}

}  // namespace

Camera default_camera() {
  Camera camera;
  camera.name = "camera";
  camera.model = Pinhole{410, 410, 255.5, 191.5};
  camera.width = 512;
  camera.height = 384;
  return camera;
}

Result<std::unique_ptr<Sequence>> Sequence::create(SequenceOptions options, const Rig& rig,
                                                   ThreadPool& pool) {
  if (auto r = check(options); !r) return r.error();
  if (auto r = check(rig, options); !r) return r.error();
  Result<World> world = make_world(options.world, {options.length, options.seed}, pool);
  if (!world) return world.error();
  fill_in(options, *world, usual_length(options.world));
  options.render.seed = options.seed;
  const MotionOptions motion_options{options.motion, options.frames / options.fps,
                                     options.length, options.seed,
                                     options.zoom,   options.rounds};
  Result<Motion> motion = make_motion(world->stage, world->habit, motion_options);
  if (!motion) return motion.error();

  std::unique_ptr<Sequence> sequence(
      new Sequence(std::move(options), rig, *std::move(world), *std::move(motion)));
  for (const Camera& camera : rig.cameras) {
    sequence->renderers_.emplace_back(sequence->world_, camera, sequence->options_.render, pool);
  }
  return sequence;
}

Camera Sequence::camera(int frame, int number) const {
  const Camera& given = rig_.cameras[static_cast<size_t>(number)];
  if (!zooms()) return given;
  const double part = static_cast<double>(frame) / std::max(frames() - 1, 1);
  const double factor = zoom_factor(options_.zoom, part);
  const Lens lens = *lens_of(given);
  return with_focal_lengths(given, factor * lens.fx, factor * lens.fy);
}

Image<uint8_t> Sequence::render(int frame, int camera_number) {
  Renderer& renderer = renderers_[static_cast<size_t>(camera_number)];
  if (zooms()) renderer.change_lens(camera(frame, camera_number));
  return renderer.render(motion_, timestamp(frame), frame, camera_number);
}

}  // namespace raysfm::synth
