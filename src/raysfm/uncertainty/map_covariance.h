#pragma once

#include <span>
#include <vector>

#include "raysfm/core/archive.h"
#include "raysfm/geometry/pose.h"
#include "raysfm/scene/map.h"
#include "raysfm/scene/reconstruction.h"
#include "raysfm/views/tracking_rig.h"

namespace raysfm {

// How well the poses of growing maps are known, as far as the errors of the maps themselves go: of their
// newest key frames, measured anew with every tenth by window_covariance(). What a frame is posed by has
// these errors too, so that they belong to its covariance (Eudes and Lhuillier 2009). `world` names a map.
class MapCovariance {
 public:
  // Whether a map that was adjusted has many more key frames than when it was measured, or begins.
  bool is_due(const Map& map) const;
  // `deviations`: how well the calibration is known, as of window_covariance().
  void measure(const TrackingRig& rig, std::span<const Rig> deviations, const Map& map, int world);
  // All key frames of a map that grows no more.
  void measure_all(const TrackingRig& rig, std::span<const Rig> deviations, const Map& map, int world);

  // Covariance of the tangent of a frame's rig_from_world with respect to the key frames about it
  // (docs/conventions.md), from the one with points held fixed and the pose of the frame before the key frame
  // that it hangs on, which was taken at input frame `keyframe_frame`.
  Matrix6d of(int world, int keyframe_frame, const Rigid3& rig_from_keyframe,
              const Matrix6d& points_fixed) const;
  // What the errors of the calibration add to that, as far as it is known now: poses moved when it became
  // known.
  Matrix6d by_calibration(int world, int keyframe_frame, const Rigid3& rig_from_keyframe) const;

  // The unit of length of a world changed.
  void rescale(int world, double factor);
  // A world became part of another.
  void renumber(int world, int into);

  template <typename A>
  void archive(A& a) {
    raysfm::archive(a, known_, measured_, factor_);
  }

 private:
  struct Known {
    int frame = 0;  // that the key frame was taken at
    int world = 0;
    Matrix6d covariance = Matrix6d::Zero();  // of the tangent of its rig_from_world
    Matrix6d by_calibration = Matrix6d::Zero();

    template <typename A>
    void archive(A& a) {
      raysfm::archive(a, frame, world, covariance, by_calibration);
    }
  };

  void measure_window(const TrackingRig& rig, std::span<const Rig> deviations, const Map& map, int world,
                      int end);
  void keep(const Known& found, bool is_better);
  const Known* nearest(int world, int frame) const;

  std::vector<Known> known_;  // ascending frames
  int measured_ = 0;          // key frames of the map when it was measured
  double factor_ = 1;         // by which errors that go together enlarge a covariance
};

}  // namespace raysfm
