#include "raysfm/solving/solve_settings.h"

#include <fmt/format.h>

#include <cmath>

#include "raysfm/core/thread_pool.h"
#include "raysfm/results/tracks_file.h"

namespace raysfm {

std::vector<SettingField> setting_fields(SolveSettings& s) {
  return {
      {"camera",
       "file of the camera that took all of the photos, any model with one viewpoint; without it the lens is "
       "found",
       &s.camera,
       {}},
      {"lens", "whether the lens zooms; auto lets the images decide", &s.lens, {"auto", "fixed", "zoom"}},
      {"distortion",
       "radial distortion of the lens; auto estimates it and keeps it where it is sure",
       &s.distortion,
       {"auto", "none", "radial"}},
      {"method",
       "adjustment: intrinsics-free, with the lenses as unknowns, or both in this order",
       &s.method,
       {"intrinsics-free", "standard", "polished"}},
      {"constraints",
       "how the intrinsics-free adjustment imposes what is known of the lenses",
       &s.constraints,
       {"weights", "lagrange"}},
      {"images",
       "what images are: a video, or photos, every one of which is compared with every other; auto lets them "
       "decide",
       &s.images,
       {"auto", "video", "photos"}},
      {"size", "WIDTHxHEIGHT of the images, for tracks in a file", &s.size, {}},
      {"structure",
       "CSV of known positions of the points of a file of tracks: point,x,y,z",
       &s.structure,
       {}},
      {"fps", "frames per second of inputs without timestamps", &s.fps, {}},
      {"from", "seconds of a video at which to begin", &s.range.from, {}},
      {"to", "seconds of a video at which to end; 0 for all of it", &s.range.to, {}},
      {"features", "corners in an image", &s.features, {}},
      {"max-error", "pixels by which an observation may be off", &s.max_error, {}},
      {"seed", "seed of every random choice", &s.seed, {}},
      {"threads", "worker threads; 0 for as many as the machine has", &s.threads, {}},
  };
}

Result<void> validate(SolveSettings settings) {
  constexpr int kMaxFeatures = 100000;
  if (auto r = check_allowed(setting_fields(settings)); !r) return r.error();
  if (auto r = check_threads(settings.threads); !r) return r.error();
  if (settings.features < 1 || settings.features > kMaxFeatures) {
    return bad_input(fmt::format("--features = {}: must be 1 to {}", settings.features, kMaxFeatures));
  }
  if (!settings.structure.empty() && !is_tracks_file(settings.input)) {
    return bad_input(fmt::format("--structure = '{}': allowed with a file of tracks only, {} is none",
                                 settings.structure, settings.input));
  }
  if (!settings.camera.empty() && !settings.structure.empty())
    return bad_input("--structure: not with --camera, where nothing of the lens is unknown");
  if (!settings.camera.empty() && (settings.lens == "zoom" || settings.images == "video")) {
    return bad_input(
        fmt::format("--{}: not with --camera, of which all images are photos; raysfm track takes "
                    "a video of a known camera",
                    settings.lens == "zoom" ? "lens zoom" : "images video"));
  }
  if (!settings.range.is_all() && is_tracks_file(settings.input)) {
    return bad_input(fmt::format("--from, --to: allowed with images only, {} holds tracks", settings.input));
  }
  if (!(settings.max_error > 0) || !std::isfinite(settings.max_error)) {
    return bad_input(fmt::format("--max-error = {}: must be above 0, in pixels", settings.max_error));
  }
  return {};
}

}  // namespace raysfm
