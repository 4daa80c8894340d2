#include <cstdio>

#include "raysfm/api/track.h"
#include "raysfm/eval/trajectory_error.h"

// Uses the lowest and the highest floor of the installed library: evaluates a path against itself, and asks
// for a reconstruction of a video that does not exist, which must be refused with a message.
int main() {
  raysfm::Trajectory path;
  for (int i = 0; i < 10; ++i) {
    path.timestamps.push_back(i);
    path.world_from_cam.push_back({Eigen::Quaterniond::Identity(), {1.0 * i, 0.5 * i * i, 0}});
  }
  const auto evaluation = raysfm::evaluate(path, path, {});
  if (!evaluation || evaluation->ate.max > 1e-9) return 1;

  raysfm::TrackSettings settings;
  settings.inputs = {"no such video"};
  const auto result = raysfm::track(settings, {});
  if (result.ok() || result.error().kind != raysfm::ErrorKind::kBadInput) return 1;
  std::printf("refused as it should be: %s\n", result.error().message.c_str());
  return 0;
}
