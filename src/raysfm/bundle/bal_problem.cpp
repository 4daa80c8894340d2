#include "raysfm/bundle/bal_problem.h"

#include "raysfm/bundle/bundle_adjuster.h"

namespace raysfm {
namespace {

// A BAL problem as a bundle problem with lenses.
struct Converted {
  std::vector<Rigid3> poses;
  std::vector<BalLens> lenses;
  std::vector<BundleObservation> observations;

  explicit Converted(const BalProblem& bal) {
    poses.reserve(bal.cameras.size());
    lenses.reserve(bal.cameras.size());
    for (const std::array<double, 9>& c : bal.cameras) {
      poses.push_back({exp_so3({c[0], c[1], c[2]}), {c[3], c[4], c[5]}});
      lenses.push_back({c[6], c[7], c[8]});
    }
    observations.reserve(bal.observations.size());
    for (const BalProblem::Observation& o : bal.observations) {
      observations.push_back({o.camera, o.point, 0, o.pixel});
    }
  }

  BundleProblem problem(BalProblem* bal) {
    BundleProblem problem{};
    problem.rig_from_world = poses;
    problem.points = bal->points;
    problem.observations = observations;
    problem.lenses = lenses;
    return problem;
  }

  void store(BalProblem* bal) const {
    for (size_t i = 0; i < poses.size(); ++i) {
      const Eigen::Vector3d w = log_so3(poses[i].rotation), t = poses[i].translation;
      bal->cameras[i] = {w[0], w[1], w[2], t[0], t[1], t[2], lenses[i].f, lenses[i].k1, lenses[i].k2};
    }
  }
};

}  // namespace

BundleSummary adjust_bal(BalProblem* problem, BundleMethod method, const BundleMethodOptions& options) {
  Converted converted(*problem);
  const BundleSummary summary = adjust(converted.problem(problem), method, options);
  if (summary.termination != Termination::kInvalidProblem) converted.store(problem);
  return summary;
}

BundleSummary adjust_bal(BalProblem* problem, const BundleOptions& options) {
  return adjust_bal(problem, BundleMethod::kGlobal, {.bundle = options});
}

}  // namespace raysfm
