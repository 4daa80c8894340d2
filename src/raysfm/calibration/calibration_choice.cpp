#include "raysfm/calibration/calibration_choice.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numeric>

namespace raysfm {
namespace {

// Part of the prior's standard deviation below which a number counts as told.
constexpr double kTold = 0.5;
// Patches are found a few hundredths of a pixel from where they are, and not at random: a change that moves
// what was observed by much less is not believed, however many observations agree.
constexpr double kLeastEffect = 0.01;
// Standard deviations by which a number must be off to be changed.
constexpr double kSignificant = 4;
// The same of a readout along the longer side of the image. Sensors are read row by row, and their rows are
// the longer side, unless a picture was cropped since: on kitti07, whose shutter does not roll, other errors
// look like such a readout of 4 to 5 standard deviations.
constexpr double kSurely = 8;
// Standard deviations of its prior by which a focal length is that of another lens, and what the prior is
// then multiplied by.
constexpr double kContradiction = 4, kAnotherLens = 10;

// Some of the unknowns, in units of the standard deviations of their priors.
struct Posterior {
  Eigen::VectorXd values;
  Eigen::MatrixXd covariance;
};

// With S the information, M the covariance of the gradient and t the unknowns, the evidence is S t = S at - g
// up to an error of covariance M.
Posterior estimate(const CalibrationEvidence& e, const Eigen::VectorXd& prior_sigma,
                   const std::vector<int>& told) {
  constexpr double kRounding = 1e-9;
  const Eigen::VectorXd unit = prior_sigma(told);
  const Eigen::MatrixXd s = unit.asDiagonal() * e.information(told, told) * unit.asDiagonal();
  // What is held is at zero.
  const Eigen::VectorXd moment = e.information * e.at - e.gradient;
  const Eigen::VectorXd right = unit.asDiagonal() * moment(told);
  const double sigma2 = 2 * e.cost / std::max(1, 2 * e.observations);
  Eigen::MatrixXd m = unit.asDiagonal() * e.scatter(told, told) * unit.asDiagonal();
  m += sigma2 * s;
  m.diagonal().array() += kRounding * std::max(1.0, m.diagonal().maxCoeff());
  const Eigen::LDLT<Eigen::MatrixXd> of_gradient(m);
  const Eigen::MatrixXd weighted = of_gradient.solve(s);  // M^-1 S
  Posterior posterior;
  const Eigen::Index n = s.rows();
  const Eigen::MatrixXd identity = Eigen::MatrixXd::Identity(n, n);
  posterior.covariance = (s * weighted + identity).ldlt().solve(identity);
  posterior.values = posterior.covariance * (weighted.transpose() * right);
  return posterior;
}

CalibrationChoice choose(const Eigen::VectorXd& prior_sigma, const CalibrationEvidence& evidence) {
  const int m = static_cast<int>(prior_sigma.size());
  std::vector<int> open(m);
  std::iota(open.begin(), open.end(), 0);
  CalibrationChoice choice{Eigen::VectorXd::Zero(m), prior_sigma, Eigen::VectorXd::Zero(m),
                           std::vector<uint8_t>(m, 0)};
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
    choice.significance[open[k]] = std::abs(posterior.values[k]) / sigma;
  }
  while (!open.empty()) {
    posterior = estimate(evidence, prior_sigma, open);
    const Eigen::ArrayXd variances = posterior.covariance.diagonal();
    if ((posterior.values.array().square() / variances).minCoeff(&least) >= kSignificant * kSignificant)
      break;
    open.erase(open.begin() + least);
  }
  for (size_t k = 0; k < open.size(); ++k) {
    const int i = open[k];
    choice.values[i] = prior_sigma[i] * posterior.values[k];
    choice.significance[i] = std::abs(posterior.values[k]) / std::sqrt(posterior.covariance(k, k));
  }
  const Eigen::VectorXd change = choice.values - evidence.at;
  choice.effect = std::sqrt(change.dot(evidence.information * change) / std::max(1, evidence.observations));
  return choice;
}

// With those standard deviations of the prior, but where the lens is another one.
CalibrationChoice choose_lens(const RigParameters& parameters, const Eigen::VectorXd& sigma,
                              const CalibrationEvidence& evidence) {
  const int m = parameters.size();
  Eigen::VectorXd wide(m);
  for (int i = 0; i < m; ++i) {
    wide[i] = sigma[i] * (parameters[i].kind == RigParameters::Kind::kFocal ? kAnotherLens : 1);
  }
  CalibrationChoice other = choose(wide, evidence);
  for (int i = 0; i < m; ++i)
    other.contradicts |= std::abs(other.values[i]) > kContradiction * sigma[i] && wide[i] > sigma[i];
  return other.contradicts ? other : choose(sigma, evidence);
}

bool is_readout(const RigParameters& parameters, int i) {
  return parameters[i].kind == RigParameters::Kind::kReadout;
}

bool is_along_longer_side(const RigParameters& parameters, int readout) {
  const Camera& camera = parameters.given().cameras[parameters[readout].camera];
  return parameters[readout].index == 0 ? camera.height > camera.width : camera.width > camera.height;
}

// With all readouts held but one; -1: but none.
CalibrationChoice choose_with_readout(const RigParameters& parameters, int readout,
                                      CalibrationEvidence evidence) {
  constexpr double kHeld = 1e-9;
  if (readout < 0 && parameters.has_readout()) evidence.scatter = evidence.lens_scatter;
  Eigen::VectorXd sigma(parameters.size());
  for (int i = 0; i < parameters.size(); ++i) {
    sigma[i] = parameters[i].prior_sigma;
    if (is_readout(parameters, i) && i != readout) sigma[i] *= kHeld;
  }
  CalibrationChoice choice = choose_lens(parameters, sigma, evidence);
  for (int i = 0; i < parameters.size(); ++i) {
    if (is_readout(parameters, i) && i != readout) choice.sigma[i] = parameters[i].prior_sigma;
  }
  return choice;
}

}  // namespace

// Rows and columns are not scanned at once. A readout that is not found is no unknown at all, so that lenses
// of global shutters are found as if there were no others.
CalibrationChoice choose_calibration(const RigParameters& parameters, const CalibrationEvidence& evidence) {
  CalibrationChoice best = choose_with_readout(parameters, -1, evidence);
  double most = 0;
  for (int i = 0; i < parameters.size(); ++i) {
    if (!is_readout(parameters, i)) continue;
    CalibrationChoice choice = choose_with_readout(parameters, i, evidence);
    if (choice.values[i] == 0 || choice.significance[i] <= most) continue;
    if (choice.significance[i] < kSurely && is_along_longer_side(parameters, i)) continue;
    most = choice.significance[i];
    best = std::move(choice);
  }
  return best;
}

bool is_worth_it(const CalibrationChoice& choice) {
  return choice.effect > kLeastEffect;
}

}  // namespace raysfm
