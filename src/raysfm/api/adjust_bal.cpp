#include <cmath>
#include <numeric>

#include "raysfm/api/adjust_model.h"
#include "raysfm/bundle/bal_problem.h"
#include "raysfm/geometry/rotation.h"

namespace raysfm {
namespace {

// The part of the file that takes part.
BalProblem problem_of(const BalFile& file, const AdjustSelection& selection) {
  BalProblem problem;
  for (const int i : selection.images) problem.cameras.push_back(file.cameras[i]);
  for (const int i : selection.points) problem.points.push_back(file.points[i]);
  for (const BalObservation& o : file.observations) {
    const int point = selection.point_number[o.point];
    if (point >= 0) problem.observations.push_back({selection.image_number[o.camera], point, o.pixel});
  }
  return problem;
}

// Root mean square of the reprojection errors of the observations whose point is before its camera.
double rms_of(const BalProblem& problem) {
  double sum = 0;
  int64_t count = 0;
  for (const BalProblem::Observation& o : problem.observations) {
    const auto& c = problem.cameras[o.camera];
    const Eigen::Vector3d p =
        exp_so3({c[0], c[1], c[2]}) * problem.points[o.point] + Eigen::Vector3d(c[3], c[4], c[5]);
    if (!(p.z() < 0)) continue;
    const Eigen::Vector2d n = -p.head<2>() / p.z();
    const double q = n.squaredNorm();
    const double squared = (c[6] * (1 + q * (c[7] + q * c[8])) * n - o.pixel).squaredNorm();
    if (!std::isfinite(squared)) continue;
    sum += squared;
    ++count;
  }
  return count > 0 ? std::sqrt(sum / static_cast<double>(count)) : 0.0;
}

}  // namespace

Result<void> adjust_bal_file(const AdjustTask& task, BalFile* file, AdjustOutcome* outcome) {
  std::vector<SeenPoint> seen;
  seen.reserve(file->observations.size());
  for (const BalObservation& o : file->observations) seen.push_back({o.camera, o.point});
  std::vector<int> order(file->cameras.size());
  std::iota(order.begin(), order.end(), 0);
  const AdjustSelection selection(seen, order, static_cast<int>(file->points.size()));
  outcome->images = outcome->cameras = static_cast<int>(file->cameras.size());
  outcome->points = static_cast<int>(file->points.size());
  outcome->images_left_out = outcome->images - static_cast<int>(selection.images.size());
  outcome->points_left_out = outcome->points - static_cast<int>(selection.points.size());
  BalProblem problem = problem_of(*file, selection);
  if (problem.observations.empty())
    return no_reconstruction("nothing to adjust, no point is seen by two cameras");
  if (auto r = task.ready(); !r) return r;

  outcome->initial_rms_px = rms_of(problem);
  outcome->summary = adjust_bal(&problem, task.method, task.options);
  if (keeps_start(outcome)) return {};
  outcome->final_rms_px = rms_of(problem);
  for (size_t i = 0; i < selection.images.size(); ++i)
    file->cameras[selection.images[i]] = problem.cameras[i];
  for (size_t i = 0; i < selection.points.size(); ++i) file->points[selection.points[i]] = problem.points[i];
  return {};
}

}  // namespace raysfm
