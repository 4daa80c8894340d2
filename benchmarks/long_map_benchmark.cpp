// What a closing and the final adjustments of a long map cost, in seconds of the processor, memory and
// metres: a drive round a block with the drift of an odometry, one metre from key frame to key frame. Usage:
//   long_map_benchmark closing [KEYFRAMES...]     one round and a little more; default 200 1000 5000
//   long_map_benchmark global|hierarchical KEYFRAMES [POINTS [FOLDER]]    rounds of 1000, each of which meets
//                                                 the ones before; POINTS in a key frame (250); what is far
//                                                 lies in FOLDER, 128 MiB of it in memory
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <string>

#include "raysfm/core/memory.h"
#include "raysfm/core/paged_memory.h"
#include "raysfm/mapping/mapper.h"
#include "raysfm/places/loop_closing.h"
#include "support/long_drive.h"

namespace {

using namespace raysfm;
using test::LongDrive;

// Other programs may be running.
double processor_seconds() {
  return static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
}

class Steps {
 public:
  explicit Steps(const LongDrive& drive) : drive_(drive) { tell("as the odometry left it"); }
  void tell(const char* step) {
    std::printf("  %-34s %7.2f s  error %8.3f m  memory at most %6.0f MiB\n", step,
                processor_seconds() - begin_, test::position_error(drive_), peak_rss_mib());
    std::fflush(stdout);
    begin_ = processor_seconds();
  }

 private:
  const LongDrive& drive_;
  double begin_ = processor_seconds();
};

// The key frame is where that of the round before was.
LoopClosure closure(const LongDrive& drive, int here, int there) {
  const Rigid3 there_from_here = drive.truth[there] * drive.truth[here].inverse();
  const double unit = test::unit_at(drive, there);
  return {here,
          there,
          {test::unit_at(drive, here) / unit, there_from_here.rotation, there_from_here.translation / unit}};
}

// Points that begin at key frames [first, last) become those of earlier rounds.
void fuse(int first, int last, LongDrive* drive) {
  for (int k = first; k < last; ++k) fuse_points(drive->same_points[k], &drive->map);
}

void close(int keyframes, bool all_points) {
  constexpr int kAgain = 100, kSeen = 10;
  LongDrive drive = test::long_drive({.keyframes = keyframes, .round = keyframes - kAgain});
  const OdometryOptions options;
  const TrackingRig rig(drive.rig);
  Mapper mapper(rig, options);
  std::printf("closing over %d key frames, adjusted by %s\n", keyframes, all_points ? "all points" : "some");
  Steps steps(drive);
  close_loop(closure(drive, keyframes - 1, kAgain - 1), false, &drive.map);
  steps.tell("graph");
  fuse(keyframes - kSeen, keyframes, &drive);
  steps.tell("points fused");
  if (all_points) {
    mapper.adapt_to_cameras(0, false, &drive.map);
  } else {
    mapper.adjust_thinned(&drive.map);
  }
  steps.tell("adjusted");
  mapper.adapt_to_cameras(0, true, &drive.map);
  steps.tell("adjusted to the end");
}

void adjust_finally(bool hierarchically, int keyframes, int points) {
  constexpr int kRound = 1000, kVisit = 100;
  LongDrive drive = test::long_drive({.keyframes = keyframes, .round = kRound, .points = points});
  const OdometryOptions options;
  const TrackingRig rig(drive.rig);
  Mapper mapper(rig, options);
  size_t observations = 0;
  for (const MapKeyFrame& k : drive.map.keyframes) observations += k.pixels.size();
  std::printf("%d key frames, %zu tracks, %zu observations, final %s\n", keyframes, drive.map.tracks.size(),
              observations, hierarchically ? "hierarchical" : "global");
  Steps steps(drive);
  for (int k = kRound; k + kVisit <= keyframes; k += kVisit) {
    close_loop(closure(drive, k, k - kRound), false, &drive.map);
    fuse(k, k + kVisit, &drive);
  }
  steps.tell("graphs");
  if (hierarchically) {
    mapper.adjust_hierarchically(&drive.map);
  } else {
    mapper.adjust_globally(&drive.map);
  }
  steps.tell("adjusted");
}

}  // namespace

int main(int argc, char** argv) {
  const std::string what = argc > 1 ? argv[1] : "closing";
  if (what == "closing") {
    std::vector<int> sizes;
    for (int i = 2; i < argc; ++i) sizes.push_back(std::atoi(argv[i]));
    if (sizes.empty()) sizes = {200, 1000, 5000};
    for (const int keyframes : sizes) {
      for (const bool all_points : {true, false}) close(keyframes, all_points);
    }
  } else {
    if (argc > 4) {
      if (const auto paged = page_to(argv[4], size_t{128} << 20); !paged) {
        return std::printf("%s\n", paged.error().message.c_str()), 1;
      }
    }
    adjust_finally(what == "hierarchical", argc > 2 ? std::atoi(argv[2]) : 1000,
                   argc > 3 ? std::atoi(argv[3]) : 250);
  }
}
