#include "raysfm/uncalibrated/known_structure.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "raysfm/uncalibrated/known_structure_problem.h"
#include "raysfm/uncalibrated/known_structure_start.h"
#include "raysfm/uncalibrated/lens_choice.h"

namespace raysfm {
namespace {

constexpr int kRounds = 5;                   // of adjustment and judgement
constexpr double kMaxKnownFocalSigma = 0.3;  // of the focal length, of a lens that is determined

double squared_error(const PointTracks& tracks, const UncalibratedReconstruction& r, int k) {
  return pixel_residual(tracks, r.scene, r.radial, k).squaredNorm();
}

// Of the observations of images with a pose: which agree; an image without enough of them loses its pose.
void judge(const PointTracks& tracks, double max_error, UncalibratedReconstruction* r) {
  std::vector<int> agreeing(tracks.image_count, 0);
  for (int k = 0; k < tracks.size(); ++k) {
    r->inlier[k] = r->image_posed[tracks.image[k]] && squared_error(tracks, *r, k) < max_error * max_error;
    agreeing[tracks.image[k]] += r->inlier[k];
  }
  for (int j = 0; j < tracks.image_count; ++j) r->image_posed[j] &= agreeing[j] >= kMinKnownPoints;
  for (int k = 0; k < tracks.size(); ++k) r->inlier[k] &= r->image_posed[tracks.image[k]];
}

void read_sigmas(const ObservationIndex& index, const LensConstraints& constraints, double variance,
                 KnownStructureProblem* problem, UncalibratedReconstruction* r) {
  const Eigen::MatrixXd basis = lens_basis(constraints);
  const auto own = basis.cols();
  for (int j = 0; j < index.image_count(); ++j) {
    LensVector& sigma = r->lens_sigma[index.images[j]];
    if (constraints.equal && j > 0) {
      sigma = r->lens_sigma[index.images[0]];
      continue;
    }
    const Eigen::MatrixXd covariance = variance * problem->lens_covariance(j);
    if (covariance.size() == 0) continue;
    const Eigen::MatrixXd of_lens = basis * covariance.topLeftCorner(own, own) * basis.transpose();
    sigma = of_lens.diagonal().cwiseMax(0).cwiseSqrt();
    if (!constraints.equal) continue;
    r->radial_sigma = {std::sqrt(covariance(own, own)), std::sqrt(covariance(own + 1, own + 1))};
  }
}

// One adjustment of what agrees, with the weights that the errors before it give. False where no image is
// left that has enough points in front of it.
bool adjust(const PointTracks& tracks, const LensConstraints& constraints, const RobustLoss& loss,
            UncalibratedReconstruction* r) {
  std::vector<double> weights(tracks.size(), 0);
  for (int k = 0; k < tracks.size(); ++k) {
    if (r->inlier[k]) weights[k] = std::max(1e-6, loss.weight(squared_error(tracks, *r, k)));
  }
  const ObservationIndex index = index_observations(tracks, weights, &r->scene, kMinKnownPoints, 1);
  if (index.image_count() == 0) return false;
  UncalibratedScene part;
  for (const int j : index.images) {
    part.cam_from_world.push_back(r->scene.cam_from_world[j]);
    part.lenses.push_back(r->scene.lenses[j]);
  }
  for (const int i : index.points) part.points.push_back(r->scene.points[i]);
  KnownStructureProblem problem(index, constraints, std::move(part), r->radial);
  LensAdjustmentSummary& summary = r->adjustment;
  const int before = summary.lm.iterations;
  const double first_cost = summary.lm.initial_cost;
  summary.lm = levenberg_marquardt(
      problem, {.max_iterations = 100, .min_relative_decrease = 1e-9, .initial_damping = 1e-3});
  if (before > 0) summary.lm.initial_cost = first_cost;
  summary.lm.iterations += before;
  r->radial = problem.distortion();
  for (int j = 0; j < index.image_count(); ++j) {
    r->scene.cam_from_world[index.images[j]] = problem.scene().cam_from_world[j];
    r->scene.lenses[index.images[j]] = problem.scene().lenses[j];
  }
  double weighted = 0;
  for (int k = 0; k < tracks.size(); ++k) {
    if (weights[k] > 0) weighted += weights[k] * squared_error(tracks, *r, k);
  }
  const auto own = static_cast<int>(lens_basis(constraints).cols());
  const int numbers = 6 * index.image_count() + (constraints.equal ? own + 2 : own * index.image_count());
  const int freedom = 2 * index.size() - numbers;
  r->lens_sigma.assign(tracks.image_count, LensVector::Constant(std::numeric_limits<double>::infinity()));
  const bool linear = std::isfinite(problem.linearize());
  if (linear && freedom > 0) read_sigmas(index, constraints, weighted / freedom, &problem, r);
  return true;
}

// The figures of what agrees, and whether most lenses are determined.
void finish(const PointTracks& tracks, UncalibratedReconstruction* result) {
  UncalibratedReconstruction& r = *result;
  r.lens_sigma.resize(tracks.image_count);
  r.point_placed.assign(tracks.point_count, 0);
  int count = 0;
  for (int k = 0; k < tracks.size(); ++k) {
    if (!r.inlier[k]) continue;
    r.point_placed[tracks.point[k]] = 1;
    ++count;
  }
  r.rms_px = rms_error(tracks, r.scene, r.radial, r.inlier);
  r.start_inliers = count;
  r.adjustment.rms_px = r.rms_px;
  r.adjustment.used = count;
  r.adjustment.dropped = tracks.size() - count;
  r.adjustment.lens_sigma = r.lens_sigma;
  int posed = 0, determined = 0;
  for (int j = 0; j < tracks.image_count; ++j) {
    posed += r.image_posed[j];
    determined += r.image_posed[j] && r.lens_sigma[j][0] < kMaxKnownFocalSigma * r.scene.lenses[j].fx;
  }
  if (2 * determined <= posed) r.degenerate = "known points at one depth";
}

Result<UncalibratedReconstruction> solve_lens(const PointTracks& tracks,
                                              std::span<const Eigen::Vector3d> points,
                                              const SolveOptions& options, bool equal) {
  constexpr double kStartError = 5;  // times the largest allowed
  auto start = known_structure_start(tracks, points,
                                     {.max_error_px = kStartError * options.max_error_px,
                                      .max_samples = options.max_samples,
                                      .seed = options.seed,
                                      .equal_lenses = equal});
  if (!start) return no_reconstruction("known structure: its points lie on a line");
  UncalibratedReconstruction r;
  r.scene = std::move(start->scene);
  r.image_posed = std::move(start->image_posed);
  r.inlier = std::move(start->inlier);
  r.world_is_given = true;
  r.zooming = !equal;
  r.lens_evidence = "as asked for";
  const LensConstraints constraints = constraints_for(tracks, options, equal);
  const RobustLoss loss{RobustLoss::Kind::kHuber, options.max_error_px / 2};
  bool agrees = true;
  for (int round = 0; round < kRounds && agrees; ++round) {
    agrees = adjust(tracks, constraints, loss, &r);
    judge(tracks, options.max_error_px, &r);
  }
  if (!agrees || std::ranges::count(r.inlier, 1) == 0) {
    return no_reconstruction("known structure: no image agrees with it in " +
                             std::to_string(kMinKnownPoints) + " points");
  }
  finish(tracks, &r);
  return r;
}

}  // namespace

Result<UncalibratedReconstruction> reconstruct_known(const PointTracks& tracks,
                                                     std::span<const Eigen::Vector3d> points,
                                                     const SolveOptions& options) {
  if (auto ok = validate(tracks); !ok) return ok.error();
  if (static_cast<int>(points.size()) != tracks.point_count) {
    return bad_input("known structure: " + std::to_string(points.size()) + " points, must be " +
                     std::to_string(tracks.point_count));
  }
  for (size_t i = 0; i < points.size(); ++i) {
    if (!points[i].allFinite()) {
      return bad_input("known structure: point " + std::to_string(i) + " must be three finite numbers");
    }
  }
  if (options.lens != LensChange::kAuto) {
    return solve_lens(tracks, points, options, options.lens == LensChange::kFixed);
  }
  const std::vector<uint8_t> all(tracks.image_count, 1);
  return choose_lens(tracks, all, solve_lens(tracks, points, options, true),
                     solve_lens(tracks, points, options, false), options.max_error_px, ErrorRelation::kNone);
}

}  // namespace raysfm
