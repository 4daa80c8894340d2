#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "raysfm/calibration/calibration_evidence.h"

namespace raysfm {

// The calibration that evidence and prior make most likely.
struct CalibrationChoice {
  Eigen::VectorXd values;  // of RigParameters; zero where nothing is significant
  Eigen::VectorXd sigma;   // standard deviations: of the prior where is_told is 0
  Eigen::VectorXd
      likeliest;  // what `sigma` is about where is_told is 1: with all told numbers free; else zero
  Eigen::MatrixXd covariance;    // about `likeliest`, of what is told; else zero
  Eigen::VectorXd significance;  // how far the evidence has it from the given one, in standard deviations
  std::vector<uint8_t> is_told;  // 0: the evidence says little of it
  bool contradicts = false;      // a focal length is farther off than any calibration should be
  // How far the change from the calibration that the evidence is about moves what was observed, poses and
  // points adapted: root mean square, in standard deviations of an observation.
  double effect = 0;
  bool is_part = false;  // of a change that is too large for one step: see within_reach()
};

// Two things keep a number as it is given. It is not told: its standard deviation is more than half of the
// prior's. Or it is not significantly off. Those that are the least told, then the least off, are held one by
// one, and the others are found anew. Where other numbers of a lens would be off about as likely if one of it
// were held, which it is is not told, and all of them are found together.
//
// A focal length that is off by more than four standard deviations of its prior is another lens, of which the
// prior says nothing: it is then ten times as wide. Likewise the aspect of images that were squeezed, with
// one 25 times as wide.
// `longest_readout`: seconds, that none is above; 0: there is none. `takes_all`: what is told is changed
// though it is not significantly off, as nothing speaks for the given numbers.
CalibrationChoice choose_calibration(const RigParameters& parameters, const CalibrationEvidence& evidence,
                                     double longest_readout = std::numeric_limits<double>::infinity(),
                                     bool takes_all = false);

// The choice itself, or where a focal length changes by so much that the evidence, which is about the
// calibration `at`, says little of it, that part of the way which it does speak of.
CalibrationChoice within_reach(const RigParameters& parameters, const Eigen::VectorXd& at,
                               CalibrationChoice choice);

// The change of all that is told, however little it is off, from the calibration that the evidence is about;
// what is not told stays. None where it is too small for another look from there.
std::optional<Eigen::VectorXd> likelier(const RigParameters& parameters, const CalibrationEvidence& evidence,
                                        double longest_readout);

// Whether the change is worth adapting everything to it; `was_changed`: the given calibration was changed
// before.
bool is_worth_it(const CalibrationChoice& choice, bool was_changed = false);

}  // namespace raysfm
