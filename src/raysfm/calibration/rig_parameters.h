#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "raysfm/camera/camera.h"

namespace raysfm {

// How far off the calibration of a camera may be: standard deviations. The defaults are those of one by a
// target or the maker.
struct CalibrationPrior {
  double focal = 0.02;    // of the focal lengths, as a part of them
  double aspect = 0.002;  // of fy / fx, as a part of it
  double centre = 0.01;   // of the principal point, as a part of the image's longer side
  double rim = 0.03;      // of a coefficient of distortion: what moves the rim of the image by this part
  // Of a rolling shutter, seconds; 0: it is as the cameras say. Else a shutter of theirs is what was found
  // before, from where it goes on.
  double readout = 0;
  // Of a lens that was found as if no shutter rolled: where one does, little of that holds.
  bool without_shutter = false;
  // Of a rough guess: nothing speaks for its numbers but these deviations.
  bool is_guess = false;
  // Of numbers that an earlier run of the same footage found: a better one is as good.
  bool is_found = false;
};

// Whether two focal lengths are those of different lenses: farther apart than usual calibrations are off.
// `sigma`: of their ratio's logarithm, besides.
bool are_other_lenses(double focal_a, double focal_b, double sigma = 0);

// The calibration of a rig as unknowns: how far each number is from the one given, so that zero is the given
// calibration. The focal lengths of a camera are one unknown (the logarithm of their common factor) and their
// aspect another, since whatever is wrong with one is mostly wrong with both. So it is with cameras of one
// make: the unknowns of the first change all that have its model and size, which differ from it by their own.
class RigParameters {
 public:
  enum class Kind : uint8_t {
    kFocal,   // logarithm of the factor to both focal lengths
    kAspect,  // logarithm of the factor to fy / fx
    kNumber,  // added to a number of the model
    kTurn,    // rotation vector of the camera in its own frame, radians
    kShift,   // added to the position of the camera in the rig
    // Seconds from the first row to the last, or (index 1) from the first column; negative: in the other
    // direction. Of all cameras; the larger of the two counts.
    kReadout,
  };
  struct Parameter {
    int camera = 0;
    Kind kind = Kind::kNumber;
    int index = 0;           // of the model's numbers, or axis
    double prior_sigma = 0;  // how far the given one may be off
    double bent_sigma = 0;   // the same where a shutter rolls that the given one was found without
    double step = 0;         // over which derivatives are taken: about a tenth of a pixel at the rim
  };

  // A perspective camera without distortion is given one of zero. Cameras whose model has no numbers
  // have none here either, and the first camera is where the rig is.
  // `doubt` multiplies how far off the given one may be.
  explicit RigParameters(const Rig& given, double doubt = 1, const CalibrationPrior& prior = {});

  int size() const { return static_cast<int>(parameters_.size()); }
  const Parameter& operator[](int i) const { return parameters_[i]; }
  // As given, but for a shutter that was found.
  const Rig& given() const { return given_; }
  // Zero but for the readout of a shutter that was found.
  const Eigen::VectorXd& first_values() const { return first_values_; }
  // Whether the rays of a camera depend on an unknown.
  bool concerns(int i, int camera) const;
  // Whether readouts are among the unknowns.
  bool has_readout() const { return prior_.readout > 0 && size() > 0; }
  // Standard deviation of their prior, seconds.
  double readout_prior() const { return prior_.readout; }
  // Whether the given lens was found as if no shutter rolled.
  bool is_bent_by_shutter() const { return prior_.without_shutter; }
  // Whether the given lens is a rough guess.
  bool is_guess() const { return prior_.is_guess; }
  bool is_found() const { return prior_.is_found; }
  // Of the number that an unknown changes in a camera: its name, and its value in a rig.
  std::string name(int i) const;
  double number(int i, int camera, const Rig& rig) const;

  // The rig with these unknowns. Whether it is one that can be: see find_problem().
  Rig rig(const Eigen::VectorXd& values) const;

  // Standard deviations of the prior; `is_bent`: where a shutter rolls that the given lens was found without.
  Eigen::VectorXd prior_sigma(bool is_bent) const;

 private:
  void add_readout();
  void add(int camera, Kind kind, int index, double prior_sigma, double usual_sigma);
  void add_model(int camera);
  bool is_like_first(int camera) const;

  Rig given_;
  double doubt_;
  CalibrationPrior prior_;
  std::vector<Parameter> parameters_;
  Eigen::VectorXd first_values_;
};

}  // namespace raysfm
