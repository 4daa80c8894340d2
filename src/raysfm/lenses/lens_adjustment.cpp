#include "raysfm/lenses/lens_adjustment.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <string>
#include <type_traits>

#include "raysfm/lenses/intrinsics_free.h"
#include "raysfm/lenses/observation_index.h"
#include "raysfm/lenses/standard_problem.h"

namespace raysfm {
namespace {

constexpr int kMinImagesPerPoint = 2;
constexpr double kPolishDamping = 1e-6;
constexpr double kRoughDecrease = 1e-2;  // of the adjustment that is polished afterwards

Result<void> check_sizes(const PointTracks& tracks, std::span<const double> weights,
                         const UncalibratedScene& scene) {
  if (!weights.empty() && weights.size() != tracks.image.size()) {
    return bad_input("weights: " + std::to_string(weights.size()) + ", allowed 0 or " +
                     std::to_string(tracks.size()) + ", the number of observations");
  }
  for (const double weight : weights) {
    if (!(weight >= 0) || !std::isfinite(weight)) {
      return bad_input("weights: " + std::to_string(weight) + ", allowed are finite numbers from 0");
    }
  }
  const auto images = static_cast<size_t>(tracks.image_count),
             points = static_cast<size_t>(tracks.point_count);
  if (scene.cam_from_world.size() != images || scene.lenses.size() != images ||
      scene.points.size() != points) {
    return bad_input("scene: " + std::to_string(scene.cam_from_world.size()) + " poses, " +
                     std::to_string(scene.lenses.size()) + " lenses and " +
                     std::to_string(scene.points.size()) + " points, must be " + std::to_string(images) +
                     ", as many, and " + std::to_string(points));
  }
  return {};
}

Result<void> check_options(const LensAdjustmentOptions& options) {
  const LensConstraints& c = options.constraints;
  if (options.threads < 1)
    return bad_input("threads: " + std::to_string(options.threads) + ", allowed are 1 and more");
  if (!(options.constraint_weight > 0)) return bad_input("constraint_weight: must be above 0");
  if (!(c.principal_point_sigma >= 0)) return bad_input("principal_point_sigma: must be 0 or more");
  if (!c.principal_point.allFinite()) return bad_input("principal_point: must be two finite numbers");
  if (!(options.loss.scale > 0)) return bad_input("loss: scale must be above 0");
  if (options.radial_terms < 0 || options.radial_terms > 2 || (options.radial_terms > 0 && !c.equal)) {
    return bad_input("radial_terms: " + std::to_string(options.radial_terms) +
                     ", allowed are 0 to 2, and 0 where every image has its own lens");
  }
  return {};
}

Result<void> check_scene(const ObservationIndex& index, const UncalibratedScene& scene) {
  for (const int j : index.images) {
    const Rigid3& pose = scene.cam_from_world[j];
    if (pose.translation.allFinite() && pose.rotation.coeffs().allFinite() &&
        std::abs(pose.rotation.norm() - 1) < 1e-6) {
      continue;
    }
    return bad_input("scene: pose " + std::to_string(j) + " must be finite, its quaternion of unit length");
  }
  for (const int i : index.points) {
    if (!scene.points[i].allFinite())
      return bad_input("scene: point " + std::to_string(i) + " must be finite");
  }
  return {};
}

Result<void> check_amount(const ObservationIndex& index, const LensConstraints& constraints) {
  const int needed = std::max(2, min_images(constraints));
  if (index.image_count() >= needed && index.point_count() > 0) return {};
  return bad_input("images: " + std::to_string(index.image_count()) + " with at least " +
                   std::to_string(kMinPointsPerImage) + " usable points, at least " + std::to_string(needed) +
                   " are needed (known of the lenses: " + describe(constraints) + ")");
}

UncalibratedScene indexed_scene(const ObservationIndex& index, const UncalibratedScene& scene) {
  UncalibratedScene part;
  for (const int j : index.images) {
    part.cam_from_world.push_back(scene.cam_from_world[j]);
    part.lenses.push_back(scene.lenses[j]);
  }
  for (const int i : index.points) part.points.push_back(scene.points[i]);
  return part;
}

// One lens is that of the images that are not adjusted, too.
void put_back(const ObservationIndex& index, const UncalibratedScene& part, bool one_lens,
              UncalibratedScene* scene) {
  if (one_lens) scene->lenses.assign(scene->lenses.size(), part.lenses.front());
  for (int j = 0; j < index.image_count(); ++j) {
    scene->cam_from_world[index.images[j]] = part.cam_from_world[j];
    scene->lenses[index.images[j]] = part.lenses[j];
  }
  for (int i = 0; i < index.point_count(); ++i) scene->points[index.points[i]] = part.points[i];
}

// Number of the lens of each image of the index; empty where none is shared by some of them alone.
std::vector<int> shared_lenses(const ObservationIndex& index, const LensAdjustmentOptions& options) {
  std::vector<int> lenses;
  if (options.constraints.equal || options.lens_of_image.empty()) return lenses;
  for (const int j : index.images) lenses.push_back(options.lens_of_image[j]);
  return lenses;
}

// The numbers of the lenses that an adjustment has free, for the degrees of freedom.
int free_lens_numbers(const ObservationIndex& index, const LensAdjustmentOptions& options) {
  const int each = static_cast<int>(lens_basis(options.constraints).cols());
  if (options.constraints.equal) return options.radial_terms + each;
  const std::vector<int> shared = shared_lenses(index, options);
  const std::set<int> lenses(shared.begin(), shared.end());
  return each * (shared.empty() ? index.image_count() : static_cast<int>(lenses.size()));
}

// Squared distances between prediction and observation, pixels, by observation.
std::vector<double> squared_errors(const ObservationIndex& index, const UncalibratedScene& part,
                                   const RadialDistortion& radial) {
  std::vector<double> errors;
  for (int j = 0; j < index.image_count(); ++j) {
    for (int o = index.image_begin[j]; o < index.image_begin[j + 1]; ++o) {
      errors.push_back(pixel_residual(part.cam_from_world[j], part.lenses[j], radial,
                                      part.points[index.point_of[o]], index.pixel[o])
                           .squaredNorm());
    }
  }
  return errors;
}

template <typename Problem>
void find_sigma(const ObservationIndex& index, const LensAdjustmentOptions& options, double sum_of_squares,
                Problem* problem, LensAdjustmentSummary* summary) {
  constexpr int kGauge = 7;
  const LensVector unknown = LensVector::Constant(std::numeric_limits<double>::infinity());
  std::vector<LensVector> sigma(index.image_count(), unknown);
  const int freedom = 2 * index.size() - 6 * index.image_count() - 3 * index.point_count() -
                      free_lens_numbers(index, options) + kGauge;
  const int needed = min_images(options.constraints);
  if (freedom > 0 && needed > 0 && index.image_count() >= needed) {
    problem->linearize();
    const double variance = sum_of_squares / freedom;
    const auto covariances = problem->lens_covariances();
    for (size_t j = 0; j < covariances.size(); ++j) {
      const LensVector variances = variance * covariances[j].diagonal();
      if (variances.allFinite()) sigma[j] = variances.cwiseMax(0).cwiseSqrt();
    }
  }
  for (int j = 0; j < index.image_count(); ++j) summary->lens_sigma[index.images[j]] = sigma[j];
}

// By point of the tracks.
Eigen::Matrix<double, 7, Eigen::Dynamic> influence_of_points(const ObservationIndex& index,
                                                             const PointTracks& tracks,
                                                             StandardProblem* problem) {
  problem->linearize();
  const auto influence = problem->influences();
  Eigen::Matrix<double, 7, Eigen::Dynamic> result(7, influence.cols() > 0 ? tracks.point_count : 0);
  result.setZero();
  for (int i = 0; i < influence.cols(); ++i) result.col(index.points[i]) = influence.col(i);
  return result;
}

// One minimisation after another, the weights of the loss renewed between them. `further` is what the
// problem is made from besides.
template <typename Problem, typename... Further>
Result<LensAdjustmentSummary> minimise(ObservationIndex index, const LensAdjustmentOptions& options,
                                       const PointTracks& tracks, UncalibratedScene* scene,
                                       Further... further) {
  constexpr double kLeastWeight = 1e-4;  // keeps every point determined
  constexpr bool kStandard = std::is_same_v<Problem, StandardProblem>;
  LensAdjustmentSummary summary;
  summary.radial = options.radial;
  const bool robust = options.loss.kind != RobustLoss::Kind::kNone;
  const int rounds = robust ? std::max(1, options.reweightings) : 1;
  const std::vector<double> given = index.weight;
  UncalibratedScene part = indexed_scene(index, *scene);
  int iterations = 0;
  for (int round = 0; round < rounds; ++round) {
    if (round > 0) {
      const std::vector<double> errors = squared_errors(index, part, summary.radial);
      for (int o = 0; o < index.size(); ++o) {
        index.weight[o] = given[o] * std::max(kLeastWeight, options.loss.weight(errors[o]));
      }
    }
    LensAdjustmentOptions from_here = options;
    from_here.radial = summary.radial;
    Problem problem(index, from_here, part, further...);
    if (!problem.valid()) {
      return bad_input("scene: the points of an image lie on a line, or on one with its camera");
    }
    summary.lm = levenberg_marquardt(problem, options.lm);
    iterations += summary.lm.iterations;
    summary.costs = problem.costs();
    part = problem.scene();
    if constexpr (kStandard) summary.radial = problem.radial();
    if (round + 1 < rounds) continue;
    const std::vector<double> errors = squared_errors(index, part, summary.radial);
    double weighted = 0, sum = 0;
    for (int o = 0; o < index.size(); ++o) weighted += index.weight[o] * errors[o], sum += errors[o];
    summary.rms_px = std::sqrt(sum / index.size());
    if (options.with_sigma) {
      summary.lens_sigma.assign(tracks.image_count,
                                LensVector::Constant(std::numeric_limits<double>::infinity()));
      find_sigma(index, options, weighted, &problem, &summary);
    }
    if constexpr (kStandard) {
      if (options.with_influence) summary.influence = influence_of_points(index, tracks, &problem);
    }
  }
  summary.lm.iterations = iterations;
  summary.used = index.size();
  summary.dropped = tracks.size() - index.size();
  put_back(index, part, kStandard && options.constraints.equal, scene);
  return summary;
}

Result<ObservationIndex> usable(const PointTracks& tracks, std::span<const double> weights,
                                const LensAdjustmentOptions& options, const UncalibratedScene& scene) {
  if (auto ok = validate(tracks); !ok) return ok.error();
  if (auto ok = check_sizes(tracks, weights, scene); !ok) return ok.error();
  if (auto ok = check_options(options); !ok) return ok.error();
  if (!options.lens_of_image.empty() && std::ssize(options.lens_of_image) != tracks.image_count) {
    return bad_input("lens_of_image: " + std::to_string(options.lens_of_image.size()) + ", allowed 0 or " +
                     std::to_string(tracks.image_count) + ", the number of images");
  }
  // A camera too poor to say in front and behind is caught below.
  ObservationIndex index =
      index_observations(tracks, weights, &scene, kMinPointsPerImage, kMinImagesPerPoint);
  if (auto ok = check_scene(index, scene); !ok) return ok.error();
  if (auto ok = check_amount(index, options.constraints); !ok) return ok.error();
  return index;
}

// The mean lens of the images of one number in the place of each; `numbers`: one for each of the images.
void make_equal(std::span<const int> images, std::span<const int> numbers, UncalibratedScene* scene) {
  std::map<int, std::pair<LensVector, int>> sums;
  for (size_t k = 0; k < numbers.size(); ++k) {
    auto& [sum, count] = sums.try_emplace(numbers[k], LensVector::Zero(), 0).first->second;
    sum += scene->lenses[images[k]].vector();
    ++count;
  }
  for (size_t k = 0; k < numbers.size(); ++k) {
    const auto& [sum, count] = sums.at(numbers[k]);
    scene->lenses[images[k]] = Lens::from_vector(sum / count);
  }
}

// What the parameters of the standard adjustment cannot leave: the constraints.
void meet_constraints(const ObservationIndex& index, const LensAdjustmentOptions& options,
                      UncalibratedScene* scene) {
  std::vector<int> numbers = shared_lenses(index, options);
  if (options.constraints.equal) numbers.assign(index.image_count(), 0);
  make_equal(index.images, numbers, scene);
  for (const int j : index.images) scene->lenses[j] = constrained(scene->lenses[j], options.constraints);
}

// The adjustment with lenses that are read: as unknowns, or as the start of dependent ones.
Result<LensAdjustmentSummary> adjust_from_lenses(ObservationIndex index, const PointTracks& tracks,
                                                 const LensAdjustmentOptions& options, LensRole role,
                                                 UncalibratedScene* scene) {
  for (const int j : index.images) {
    const Lens& lens = scene->lenses[j];
    if (lens.vector().allFinite() && lens.fx > 0 && lens.fy > 0) continue;
    return bad_input("scene: lens " + std::to_string(j) + " must be finite, its fx and fy above 0");
  }
  meet_constraints(index, options, scene);
  const std::vector<int> images = index.images, numbers = shared_lenses(index, options);
  auto summary = minimise<StandardProblem>(std::move(index), options, tracks, scene, role);
  if (summary) make_equal(images, numbers, scene);  // their weight leaves them apart by next to nothing
  return summary;
}

}  // namespace

Result<LensAdjustmentSummary> adjust_intrinsics_free(const PointTracks& tracks,
                                                     std::span<const double> weights,
                                                     const LensAdjustmentOptions& options,
                                                     UncalibratedScene* scene) {
  auto index = usable(tracks, weights, options, *scene);
  if (!index) return index.error();
  if (options.estimate == LensEstimate::kLeastSquares) {
    return adjust_from_lenses(std::move(*index), tracks, options, LensRole::kDependent, scene);
  }
  return minimise<IntrinsicsFreeProblem>(std::move(*index), options, tracks, scene);
}

Result<LensAdjustmentSummary> adjust_standard(const PointTracks& tracks, std::span<const double> weights,
                                              const LensAdjustmentOptions& options,
                                              UncalibratedScene* scene) {
  auto index = usable(tracks, weights, options, *scene);
  if (!index) return index.error();
  return adjust_from_lenses(std::move(*index), tracks, options, LensRole::kUnknown, scene);
}

Result<LensAdjustmentSummary> adjust_polished(const PointTracks& tracks, std::span<const double> weights,
                                              const LensAdjustmentOptions& options,
                                              UncalibratedScene* scene) {
  LensAdjustmentOptions first = options, second = options;
  first.with_sigma = false;
  first.estimate = LensEstimate::kMoments;
  second.estimate = LensEstimate::kLeastSquares;
  first.lm.min_relative_decrease = std::max(kRoughDecrease, options.lm.min_relative_decrease);
  UncalibratedScene start = *scene;
  const auto rough = adjust_intrinsics_free(tracks, weights, first, &start);
  if (!rough) return rough;
  // Near the bottom, Gauss and Newton's step is a good one.
  second.lm.initial_damping = std::min(kPolishDamping, options.lm.initial_damping);
  auto summary = adjust_intrinsics_free(tracks, weights, second, &start);
  if (!summary) return summary;
  summary->lm.initial_cost = rough->lm.initial_cost;
  summary->lm.iterations += rough->lm.iterations;
  *scene = std::move(start);
  return summary;
}

}  // namespace raysfm
