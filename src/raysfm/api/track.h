#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "raysfm/core/callbacks.h"
#include "raysfm/core/result.h"
#include "raysfm/mapping/options.h"
#include "raysfm/odometry/observer.h"
#include "raysfm/results/report_file.h"
#include "raysfm/scene/reconstruction.h"
#include "raysfm/settings/config.h"

namespace raysfm {

class Tracker;
struct FoundLens;

// What `raysfm track` is told. Field names are those of the command line and of --config.
struct TrackSettings {
  std::vector<std::string> inputs;
  std::string camera;                // path; empty: taken from the input's layout
  double fov = 0;                    // degrees, horizontal, where no camera file is; 0: not told
  double fps = 0;                    // frames per second of inputs without timestamps; 0: unknown
  TimeRange range;                   // the part of the input that is read
  bool mono = false;                 // only the first camera of a rig
  int threads = 0;                   // 0: as many as the machine has; never changes a result
  std::string error = "auto";        // "auto", "pixel", "angular" or "angular-plain"; sets odometry.error
  std::string start = "auto";        // "auto", "five-point" or "pless"; sets odometry.start
  std::string refine_lens = "auto";  // "auto", "on" or "off"; sets odometry.refine_lens
  // "auto", "none" or the milliseconds of a readout: of the rolling shutters of all cameras. "auto" leaves
  // what the camera file says.
  std::string rolling_shutter = "auto";
  std::string loops = "on";     // "on" or "off"; sets odometry.loops
  std::string map;              // path of a saved map to go on from; empty: none
  std::string save_map;         // path of the one to leave; empty: none
  bool localise = false;        // only in `map`, no other world is started
  std::string final = "none";   // "none", "global" or "hierarchical": adjustment of everything at the end
  std::string preset = "none";  // "none" or "lba09": as the paper, see follow_paper()
  std::string without;          // names of departures from the paper, separated by commas
  OdometryOptions odometry;
  // File by which a run that was killed is gone on from: read where it is there, and replaced now and then.
  // Whoever has the result removes it. Empty: none.
  std::string checkpoint;
  std::string program_version;  // checkpoints of another one are not gone on from
};

struct TrackProgress {
  int frames = 0;  // done
  int total = -1;  // -1: unknown
  int posed = 0;
};

// What `track` gives.
struct TrackResult {
  Reconstruction reconstruction;
  Report report;
};

// What a caller hears while `track` runs.
using TrackCallbacks = Callbacks<const TrackProgress&>;

// Hears what happens in a run of `track` and looks at it between frames, on the thread that tracks: what it
// takes is time that the run takes. It changes nothing of the result.
class TrackWatcher : public TrackerObserver {
 public:
  // After each frame; `tracker` may be asked for what it knows.
  virtual void frame_done(const Tracker& tracker) = 0;
};

// Video of a calibrated camera to trajectory and map. Errors: bad input. A reconstruction without a single
// pose is a value; its frames say why. `watcher` may be null. `found`: the lens of the one camera, where it
// is not to be looked for and no file is to tell it; else null.
Result<TrackResult> track(const TrackSettings& settings, const TrackCallbacks& callbacks,
                          TrackWatcher* watcher = nullptr, const FoundLens* found = nullptr);

// All settings but the inputs and the output folder. The fields point into `settings`.
std::vector<SettingField> setting_fields(TrackSettings& settings);

// Text of config.yaml, as that of any subcommand.
std::string effective_config(TrackSettings settings, const std::string& version);

// What the settings say to a tracker that somebody else feeds. Errors: bad input, a name that is not known.
Result<OdometryOptions> odometry_options(const TrackSettings& settings);

// Standard deviation of a readout that nobody told, seconds: phones take 10 to 33 milliseconds.
inline constexpr double kUsualReadout = 0.02;

// What TrackSettings::rolling_shutter says to a tracker that somebody else feeds: the readouts of the cameras
// of `rig`, and with "auto", where none of them has one, in `prior` that there may be one to be found.
// Errors: bad input.
Result<void> set_rolling_shutter(const std::string& told, Rig* rig, CalibrationPrior* prior);

// What a report says of the cameras and of the stages of a tracker that was told so.
Report tracker_report(const TrackSettings& settings, const Tracker& tracker);

// Whether the results can go into `folder` without touching an input, and makes sure of the folder; else bad
// input. What takes more memory than most maps is kept in a file without a name there (core/paged_memory.h).
Result<void> prepare_track_output(const TrackSettings& settings, const std::filesystem::path& folder);

// Writes the results into the folder: write_output_folder() with config.yaml, and the cameras where they were
// refined or found. The value is whether they were written: without a pose they do not replace an older
// result.
Result<bool> write_track_output(const TrackResult& result, const TrackSettings& settings,
                                const std::string& version, const std::filesystem::path& folder);

// Why there is no pose at all, for results that write_track_output() has `written` into the folder, or not.
Error why_no_pose(const TrackResult& result, bool written, const std::filesystem::path& folder);

}  // namespace raysfm
