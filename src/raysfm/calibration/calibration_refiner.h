#pragma once

#include <functional>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "raysfm/calibration/calibration_choice.h"
#include "raysfm/calibration/refined_rig.h"
#include "raysfm/core/archive.h"
#include "raysfm/scene/map.h"
#include "raysfm/scene/reconstruction.h"
#include "raysfm/views/rolling_shutter.h"
#include "raysfm/views/tracking_rig.h"

namespace raysfm {

// What becomes of the given calibration.
enum class LensRefinement : uint8_t {
  kAuto,  // refined where the images are sure that it is off
  kOn,    // a rough guess: refined wherever the images tell it better
  kOff,   // kept
};

// A focal length that is another one in the later part of a world.
struct FocalChange {
  int keyframe = 0;              // after the last that has the earlier one
  double before = 0, after = 0;  // pixels
};

// Finds out while maps grow how far the calibration is off: collects what stretches of key frames say of it
// and weighs that against the given one. All worlds are seen through the same lenses. Owns scratch memory.
class CalibrationRefiner {
 public:
  CalibrationRefiner(const Rig& given, LensRefinement how, const CalibrationPrior& prior = {});
  // Goes on from what others made of a calibration.
  explicit CalibrationRefiner(const RefinedRig& present);

  // Whether a world has much that was not measured, or was at another scale; `last` when no more will come.
  bool is_due(int world, const Map& map, bool last) const;

  // Motion of the rig at a key frame of the world that is measured.
  using MotionOf = std::function<RigMotion(int keyframe)>;

  // Measures what of a world was not measured yet, its last stretch anew where that became longer, and all of
  // it where its scale is another now. Key frames that are left out (1; shorter: the rest is not) are in no
  // stretch.
  void measure(const TrackingRig& rig, int world, const Map& map, std::span<const uint8_t> left_out,
               const MotionOf& motion_of);

  // Whether a world is to be asked for a rolling shutter that nobody told, before anything else: once it is
  // long enough, and where it is short when no more will come (`last`). And one that it tells beyond doubt.
  bool is_shutter_due(int keyframes, bool last) const;
  std::optional<Rig> find_shutter(const TrackingRig& rig, int world, const Map& map,
                                  const MotionOf& motion_of);

  // Seconds from one frame to the next: the last row of an image is read before the first of the next.
  void set_frame_interval(double seconds);

  // Whether a rolling shutter that nobody told was found.
  bool has_found_shutter() const { return has_readout(values_); }

  // Drops the rolling shutter, and returns true, where what was measured of a world says that rows are
  // exposed in one order in a part of it and in the other in another, each beyond doubt: as where a part of a
  // video plays backwards. No readout holds for both, and none is looked for any more.
  bool drop_turning_shutter(const TrackingRig& rig, int world, const Map& map, const MotionOf& motion_of);
  bool dropped_shutter() const { return shutter_is_dropped_; }

  // A world is part of another now, or key frames moved to make room for it; or some are gone, which have the
  // number of the one before. What was measured with these stays.
  void renumber(int world, int into, std::span<const int> new_number_of_keyframe);

  // A calibration that is worth adapting everything to, or none; `last` when no more will come.
  std::optional<Rig> better(bool last);

  // Takes it over. True where that is so large a step that another from there may be worth it, once
  // measure_again() has been told what the adapted map says.
  bool take_over();

  // How a stretch is asked: by a loss that is the same for all; by one for its noise; or about the
  // calibration at which it comes to rest itself, by a loss beyond which nothing counts. What a map is made
  // of was chosen by the present calibration: matches that are wrong by less than an inlier may be, but fit
  // it, hold that against many right ones.
  enum class Measure : uint8_t { kEven, kByNoise, kAtRest };
  // Measures all of a world anew; at rest where no more will be heard of its calibration.
  void measure_again(const TrackingRig& rig, int world, const Map& map, std::span<const uint8_t> left_out,
                     const MotionOf& motion_of, Measure how = Measure::kEven);

  // Whether what was measured of a world says of its earlier part another focal length than of its later one,
  // beyond doubt: the camera zoomed, which one calibration does not hold.
  std::optional<FocalChange> focal_change(const TrackingRig& rig, int world, const Map& map,
                                          const MotionOf& motion_of);

  // Every number that is looked at, camera by camera; none where nothing was measured.
  std::vector<CalibrationNumber> numbers() const;
  // Of what better() found last: CalibrationChoice::effect.
  double effect() const { return choice_.effect; }
  // The same change, in the stretch that it moves the most: of a drive all but a turn may say nothing of it.
  double greatest_effect() const;
  // Whether the present calibration is that of another lens than the given one.
  bool contradicts() const { return contradicts_; }
  // The present calibration.
  Rig rig() const { return parameters_.rig(values_); }
  // Calibrations that are a standard deviation from the present one each, in directions that are independent
  // of one another: how well it is known in what the footage tells. Readouts are as they are.
  std::vector<Rig> deviations() const;

  template <typename A>
  void archive(A& a) {
    raysfm::archive(a, values_, choice_.values, choice_.sigma, choice_.likeliest, choice_.covariance,
                    choice_.significance, choice_.is_told, choice_.contradicts, choice_.effect,
                    choice_.is_part, contradicts_, shutter_is_dropped_, stretches_);
  }

 private:
  static constexpr int kLongest = 80;  // key frames of a stretch

  struct Stretch {
    int world = 0;
    int begin = 0, end = 0;  // key frames, the last of which is before `end`
    int keyframes = 0;       // that it had when it was measured
    double rescaled = 1;     // Map::rescaled, of the map that was measured
    CalibrationEvidence evidence;

    // Whether it may become longer.
    bool is_open() const { return keyframes == end - begin && keyframes < kLongest; }

    template <typename A>
    void archive(A& a) {
      CalibrationEvidence& e = evidence;
      raysfm::archive(a, world, begin, end, keyframes, rescaled, e.at, e.information, e.gradient, e.scatter,
                      e.lens_scatter, e.cost, e.observations);
    }
  };

  CalibrationChoice choose(const CalibrationEvidence& evidence, bool takes_all = false) const;
  double longest_readout() const { return shutter_is_dropped_ ? 0 : longest_readout_; }
  int measured_until(int world) const;
  int first_open(int world) const;
  int measured() const;
  bool is_outdated(const Stretch& stretch, int world, const Map& map) const;
  std::optional<FocalChange> change_at(std::span<const Stretch> stretches, size_t split,
                                       double* significance) const;
  double deviation(int parameter) const;
  bool has_readout(const Eigen::VectorXd& values) const;
  CalibrationNumber number(int parameter, int camera, const Rig& present) const;
  std::optional<Rig> chosen_rig() const;
  void gather(const TrackingRig& rig, const Map& map, const MotionOf& motion_of, int begin, int end,
              int points);
  int points_of(const TrackingRig& rig, int keyframes) const;
  void choose_points(const Map& map, int begin, int end, int usual);
  std::vector<Stretch> short_stretches(const TrackingRig& rig, int world, const Map& map,
                                       const MotionOf& motion_of, int end);
  void measure_from(int first, const TrackingRig& rig, int world, const Map& map,
                    std::span<const uint8_t> left_out, const MotionOf& motion_of, Measure how);
  std::optional<CalibrationEvidence> evidence_at_rest(const TrackingRig& rig, BundleProblem problem);
  Stretch measured_stretch(const TrackingRig& rig, int world, const Map& map, const MotionOf& motion_of,
                           int begin, int end, int points, Measure measure = Measure::kEven);

  LensRefinement how_;
  RigParameters parameters_;
  Eigen::VectorXd values_;
  CalibrationChoice choice_;          // of what was measured last
  bool begins_with_shutter_ = false;  // that was found before, and stays
  bool contradicts_ = false;
  bool shutter_is_dropped_ = false;
  double longest_readout_ = std::numeric_limits<double>::infinity();
  std::vector<Stretch> stretches_;

  std::vector<Rigid3> poses_;
  std::vector<uint8_t> free_;
  std::vector<Eigen::Vector3d> points_;
  std::vector<int> tracks_, point_of_track_;
  std::vector<BundleObservation> observations_;
  std::vector<ObservedRay> rays_;
  std::vector<float> sigmas_;
  std::vector<uint8_t> fits_;                // each observation, its residual
  std::vector<Eigen::Vector2d> velocities_;  // in the image, of each observation
};

}  // namespace raysfm
