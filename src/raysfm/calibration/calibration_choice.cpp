#include "raysfm/calibration/calibration_choice.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>
#include <set>

namespace raysfm {
namespace {

// Part of the prior's standard deviation below which a number counts as told.
constexpr double kTold = 0.5;
// Patches are found a few hundredths of a pixel from where they are, and not at random: a change that moves
// what was observed by much less is not believed, however many observations agree.
// One that was changed already is not exact: the better number of the two is then worth less of a change.
constexpr double kLeastEffect = 0.01, kLeastFurtherEffect = 0.002;
// Standard deviations by which a number must be off to be changed, and below which one is no longer that was.
constexpr double kSignificant = 4, kNoMore = 2;
// Logarithm of the odds at which some numbers are changed and not others, be it those changed before or what
// would be changed without one of them. Over twenty key frames a focal length and distortion explain the same
// about as well.
constexpr double kSurelyAnother = 10;
// Standard deviations by which a readout must be off along the longer side of the image. Sensors are read row
// by row, and their rows are the longer side, unless a picture was cropped since: on kitti07, whose shutter
// does not roll, other errors look like such a readout of 4 to 5 standard deviations.
constexpr double kSurely = 8;
// Seconds. No sensor that is read row by row is through sooner (the fastest, which are stacked, take 4 ms):
// what looks like less is something else (a mirror's film had 2.5 ms, of 5.8 standard deviations).
constexpr double kFastestReadout = 0.003;
// Standard deviations of its prior by which a focal length is that of another lens, or an aspect that of
// images that were squeezed, and what the prior is then multiplied by.
constexpr double kContradiction = 4, kAnotherLens = 10, kSqueezed = 25;

// Logarithm of the factor to a focal length in one step. Where it was off by a factor of two, a whole step
// led on to another lens altogether; 0.15 is as good and takes longer.
constexpr double kReach = 0.3;

// Some of the unknowns, in units of the standard deviations of their priors.
struct Posterior {
  Eigen::VectorXd values;
  Eigen::MatrixXd covariance;
};

// The evidence as a linear model of some unknowns t, in those units: with S the information, M the covariance
// of the gradient and r = S at - g, r = S t up to an error of covariance M.
struct LinearEvidence {
  Eigen::MatrixXd information;  // S M^-1 S
  Eigen::VectorXd moment;       // S M^-1 r

  // What is not among the unknowns is at zero.
  LinearEvidence(const CalibrationEvidence& e, const Eigen::VectorXd& prior_sigma,
                 const std::vector<int>& unknowns) {
    constexpr double kRounding = 1e-9;
    const Eigen::VectorXd unit = prior_sigma(unknowns);
    const Eigen::MatrixXd s = unit.asDiagonal() * e.information(unknowns, unknowns) * unit.asDiagonal();
    const Eigen::VectorXd right = e.information * e.at - e.gradient;
    const double sigma2 = 2 * e.cost / std::max(1, 2 * e.observations);
    Eigen::MatrixXd m = unit.asDiagonal() * e.scatter(unknowns, unknowns) * unit.asDiagonal();
    m += sigma2 * s;
    m.diagonal().array() += kRounding * std::max(1.0, m.diagonal().maxCoeff());
    const Eigen::MatrixXd weighted = m.ldlt().solve(s);
    information = s * weighted;
    moment = weighted.transpose() * (unit.asDiagonal() * right(unknowns));
  }

  // Of some of these, given by their places among them, the others at zero.
  Posterior posterior(const std::vector<int>& some) const {
    const auto n = static_cast<Eigen::Index>(some.size());
    const Eigen::MatrixXd identity = Eigen::MatrixXd::Identity(n, n);
    Posterior p;
    p.covariance = (information(some, some) + identity).ldlt().solve(identity);
    p.values = p.covariance * moment(some);
    return p;
  }

  Posterior posterior() const {
    std::vector<int> all(moment.size());
    std::iota(all.begin(), all.end(), 0);
    return posterior(all);
  }

  // Logarithm of how likely all of the evidence is when only these unknowns are off, against none (MacKay,
  // Information Theory 28.1).
  double log_evidence(const std::vector<int>& some) const {
    if (some.empty()) return 0;
    const Posterior p = posterior(some);
    return 0.5 * (moment(some).dot(p.values) + p.covariance.ldlt().vectorD().array().log().sum());
  }

  // By unknown: what none of those without it has more of.
  Eigen::VectorXd most_log_evidence_without() const {
    const Posterior p = posterior();
    return 0.5 * (moment.dot(p.values) - p.values.array().square() / p.covariance.diagonal().array());
  }
};

Posterior estimate(const CalibrationEvidence& e, const Eigen::VectorXd& prior_sigma,
                   const std::vector<int>& told) {
  return LinearEvidence(e, prior_sigma, told).posterior();
}

double least_significance(bool was_off) {
  return was_off ? kNoMore : kSignificant;
}

// Leaves of the unknowns those that are surely off when the others are not. The least sure goes first, and
// what `at` (empty: nothing) says is off already after all else.
void keep_the_insignificant(const CalibrationEvidence& e, const Eigen::VectorXd& prior_sigma,
                            const Eigen::VectorXd& at, std::vector<int>* open) {
  while (!open->empty()) {
    const Posterior posterior = estimate(e, prior_sigma, *open);
    int least = -1;
    double lowest = 0;
    bool is_off = true;
    for (size_t k = 0; k < open->size(); ++k) {
      const double significance2 = posterior.values[k] * posterior.values[k] / posterior.covariance(k, k);
      const bool was_off = at.size() > 0 && at[(*open)[k]] != 0;
      const double enough = least_significance(was_off);
      if (significance2 >= enough * enough || was_off > is_off) continue;
      if (least >= 0 && was_off == is_off && significance2 >= lowest) continue;
      least = static_cast<int>(k), lowest = significance2, is_off = was_off;
    }
    if (least < 0) return;
    open->erase(open->begin() + least);
  }
}

// Where each of some of the unknowns is among all of them.
std::vector<int> places_in(const std::vector<int>& all, const std::vector<int>& some) {
  std::vector<int> places;
  for (const int i : some) places.push_back(static_cast<int>(std::ranges::lower_bound(all, i) - all.begin()));
  return places;
}

// Of the unknowns that are told those that are surely off, or those that were changed before, unless the
// others are far likelier.
std::vector<int> surely_off(const CalibrationEvidence& e, const Eigen::VectorXd& prior_sigma,
                            const LinearEvidence& linear, const std::vector<int>& told) {
  std::vector<int> off = told, as_before = told;
  keep_the_insignificant(e, prior_sigma, {}, &off);
  if (e.at.isZero(0)) return off;
  keep_the_insignificant(e, prior_sigma, e.at, &as_before);
  const double gain =
      linear.log_evidence(places_in(told, off)) - linear.log_evidence(places_in(told, as_before));
  return gain >= kSurelyAnother ? off : as_before;
}

bool is_of_lens(const RigParameters::Parameter& p) {
  using Kind = RigParameters::Kind;
  return p.kind == Kind::kFocal || p.kind == Kind::kAspect || p.kind == Kind::kNumber;
}

// Leaves of the unknowns that are told those that are surely off and those of a lens that may be so in place
// of one of them. It is not told then which it is, and either alone would take all that each has a part in.
// Where the cameras of a rig are is no alternative: a baseline that is off in place of a lens is another
// scale.
void keep_what_may_be_as_given(const RigParameters& parameters, const CalibrationEvidence& e,
                               const Eigen::VectorXd& prior_sigma, std::vector<int>* open) {
  const std::vector<int> told = *open;
  if (told.empty()) return;
  const LinearEvidence linear(e, prior_sigma, told);
  const std::vector<int> off = surely_off(e, prior_sigma, linear, told);
  const std::vector<int> places = places_in(told, off);
  const double enough = linear.log_evidence(places) - kSurelyAnother;
  const Eigen::VectorXd most_without = linear.most_log_evidence_without();
  std::set<int> kept(off.begin(), off.end());
  for (size_t k = 0; k < off.size(); ++k) {
    const int i = off[k];
    if (!is_of_lens(parameters[i]) || most_without[places[k]] < enough) continue;
    std::vector<int> others;
    std::ranges::copy_if(told, std::back_inserter(others), [&](int j) {
      const bool is_of_same = is_of_lens(parameters[j]) && parameters[j].camera == parameters[i].camera;
      return j != i && (is_of_same || std::ranges::binary_search(off, j));
    });
    keep_the_insignificant(e, prior_sigma, e.at, &others);
    if (linear.log_evidence(places_in(told, others)) > enough) kept.insert(others.begin(), others.end());
  }
  open->assign(kept.begin(), kept.end());
}

// CalibrationChoice::effect of a change to some values.
double effect_of(const Eigen::VectorXd& values, const CalibrationEvidence& evidence) {
  const Eigen::VectorXd change = values - evidence.at;
  return std::sqrt(change.dot(evidence.information * change) / std::max(1, evidence.observations));
}

// `takes_all`: numbers that are told are changed though they are not significantly off, as nothing speaks for
// the given ones.
CalibrationChoice choose(const RigParameters& parameters, const Eigen::VectorXd& prior_sigma,
                         const CalibrationEvidence& evidence, bool takes_all) {
  const int m = static_cast<int>(prior_sigma.size());
  std::vector<int> open(m);
  std::iota(open.begin(), open.end(), 0);
  CalibrationChoice choice{.values = Eigen::VectorXd::Zero(m),
                           .sigma = prior_sigma,
                           .likeliest = Eigen::VectorXd::Zero(m),
                           .covariance = Eigen::MatrixXd::Zero(m, m),
                           .significance = Eigen::VectorXd::Zero(m),
                           .is_told = std::vector<uint8_t>(m, 0)};
  if (evidence.observations == 0) open.clear();  // what comes takes the fourth power of their number
  Posterior posterior;
  Eigen::Index least;
  while (!open.empty()) {
    posterior = estimate(evidence, prior_sigma, open);
    if (posterior.covariance.diagonal().maxCoeff(&least) <= kTold * kTold) break;
    open.erase(open.begin() + least);
  }
  for (size_t k = 0; k < open.size(); ++k) {
    const double sigma = std::sqrt(posterior.covariance(k, k));
    choice.is_told[open[k]] = 1;
    choice.sigma[open[k]] = prior_sigma[open[k]] * sigma;
    choice.likeliest[open[k]] = prior_sigma[open[k]] * posterior.values[k];
    choice.significance[open[k]] = std::abs(posterior.values[k]) / sigma;
  }
  if (!open.empty()) {
    const Eigen::VectorXd unit = prior_sigma(open);
    choice.covariance(open, open) = unit.asDiagonal() * posterior.covariance * unit.asDiagonal();
  }
  if (!takes_all) {
    keep_what_may_be_as_given(parameters, evidence, prior_sigma, &open);
    if (!open.empty()) posterior = estimate(evidence, prior_sigma, open);
  }
  for (size_t k = 0; k < open.size(); ++k) {
    const int i = open[k];
    choice.values[i] = prior_sigma[i] * posterior.values[k];
    choice.significance[i] = std::abs(posterior.values[k]) / std::sqrt(posterior.covariance(k, k));
  }
  choice.effect = effect_of(choice.values, evidence);
  return choice;
}

double widened(RigParameters::Kind kind) {
  if (kind == RigParameters::Kind::kFocal) return kAnotherLens;
  return kind == RigParameters::Kind::kAspect ? kSqueezed : 1;
}

// With those standard deviations of the prior, but where the lens is another one or its images were squeezed.
CalibrationChoice choose_lens(const RigParameters& parameters, const Eigen::VectorXd& sigma,
                              const CalibrationEvidence& evidence, bool takes_all) {
  const int m = parameters.size();
  Eigen::VectorXd wide(m);
  for (int i = 0; i < m; ++i) wide[i] = sigma[i] * widened(parameters[i].kind);
  CalibrationChoice other = choose(parameters, wide, evidence, takes_all);
  bool is_other = false;
  for (int i = 0; i < m; ++i) {
    if (wide[i] == sigma[i] || std::abs(other.values[i]) <= kContradiction * sigma[i]) continue;
    if (other.significance[i] < least_significance(evidence.at[i] != 0)) continue;
    is_other = true;
    other.contradicts |= parameters[i].kind == RigParameters::Kind::kFocal;
  }
  return is_other ? other : choose(parameters, sigma, evidence, takes_all);
}

bool is_readout(const RigParameters& parameters, int i) {
  return parameters[i].kind == RigParameters::Kind::kReadout;
}

bool is_along_longer_side(const RigParameters& parameters, int readout) {
  const Camera& camera = parameters.given().cameras[parameters[readout].camera];
  return parameters[readout].index == 0 ? camera.height > camera.width : camera.width > camera.height;
}

bool is_upwards(const RigParameters& parameters, int readout, const CalibrationChoice& choice) {
  return parameters[readout].index == 0 && choice.values[readout] < 0;
}

bool is_known_to_roll(const Rig& rig) {
  return std::ranges::any_of(rig.cameras, [](const Camera& camera) { return camera.shutter.readout > 0; });
}

// With all readouts held but one; -1: but none. `is_free`: the given lens may be bent by the shutter.
CalibrationChoice choose_with_readout(const RigParameters& parameters, int readout,
                                      CalibrationEvidence evidence, bool is_free, bool takes_all) {
  constexpr double kHeld = 1e-9;
  if (readout < 0 && parameters.has_readout()) evidence.scatter = evidence.lens_scatter;
  Eigen::VectorXd sigma = parameters.prior_sigma(is_free);
  for (int i = 0; i < parameters.size(); ++i) {
    if (is_readout(parameters, i) && i != readout) sigma[i] *= kHeld;
  }
  CalibrationChoice choice = choose_lens(parameters, sigma, evidence, takes_all);
  for (int i = 0; i < parameters.size(); ++i) {
    if (is_readout(parameters, i) && i != readout) choice.sigma[i] = parameters[i].prior_sigma;
  }
  return choice;
}

// Whether every focal length is better known from a choice than it was before.
bool knows_better(const RigParameters& parameters, const CalibrationChoice& choice) {
  for (int i = 0; i < parameters.size(); ++i) {
    if (parameters[i].kind != RigParameters::Kind::kFocal) continue;
    if (!choice.is_told[i] || choice.sigma[i] > parameters[i].prior_sigma) return false;
  }
  return true;
}

// A lens that was found as if no shutter rolled took some of that for its own numbers. Where one does, it is
// found anew, if the map tells it better than what it was found from.
CalibrationChoice choose_with_readout(const RigParameters& parameters, int readout,
                                      const CalibrationEvidence& evidence, bool takes_all) {
  if (parameters.is_bent_by_shutter() && (readout >= 0 || is_known_to_roll(parameters.given()))) {
    CalibrationChoice choice = choose_with_readout(parameters, readout, evidence, true, true);
    if (knows_better(parameters, choice)) return choice;
  }
  return choose_with_readout(parameters, readout, evidence, false, takes_all);
}

}  // namespace

// Rows and columns are not scanned at once. A readout that is not found is no unknown at all, so that lenses
// of global shutters are found as if there were no others.
CalibrationChoice choose_calibration(const RigParameters& parameters, const CalibrationEvidence& evidence,
                                     double longest_readout, bool takes_all) {
  CalibrationChoice best = choose_with_readout(parameters, -1, evidence, takes_all);
  double most = 0;
  for (int i = 0; i < parameters.size(); ++i) {
    if (!(longest_readout > 0) || !is_readout(parameters, i)) continue;
    CalibrationChoice choice = choose_with_readout(parameters, i, evidence, takes_all);
    if (choice.values[i] == 0 || choice.significance[i] <= most) continue;
    if (choice.significance[i] < least_significance(evidence.at[i] != 0)) continue;
    const bool is_unusual =
        is_along_longer_side(parameters, i) || (evidence.at[i] == 0 && is_upwards(parameters, i, choice));
    if (choice.significance[i] < kSurely && is_unusual) continue;
    const double readout = std::abs(choice.values[i]);
    const bool can_be = readout >= kFastestReadout && readout <= longest_readout;
    if (!can_be && !is_known_to_roll(parameters.given())) continue;
    most = choice.significance[i];
    best = std::move(choice);
  }
  return best;
}

CalibrationChoice within_reach(const RigParameters& parameters, const Eigen::VectorXd& at,
                               CalibrationChoice choice) {
  double step = 0;
  for (int i = 0; i < parameters.size(); ++i) {
    if (parameters[i].kind == RigParameters::Kind::kFocal)
      step = std::max(step, std::abs(choice.values[i] - at[i]));
  }
  if (step > kReach) {
    const double part = kReach / step;
    choice.values = at + part * (choice.values - at);
    choice.effect *= part;
    choice.is_part = true;
  }
  return choice;
}

std::optional<Eigen::VectorXd> likelier(const RigParameters& parameters, const CalibrationEvidence& evidence,
                                        double longest_readout) {
  CalibrationChoice choice = choose_calibration(parameters, evidence, longest_readout, true);
  for (int i = 0; i < parameters.size(); ++i) {
    if (!choice.is_told[i]) choice.values[i] = evidence.at[i];
  }
  Eigen::VectorXd values = within_reach(parameters, evidence.at, std::move(choice)).values;
  if (!(effect_of(values, evidence) > kLeastFurtherEffect)) return std::nullopt;
  return values;
}

bool is_worth_it(const CalibrationChoice& choice, bool was_changed) {
  return choice.effect > (was_changed ? kLeastFurtherEffect : kLeastEffect);
}

}  // namespace raysfm
