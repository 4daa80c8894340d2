#include "raysfm/camera/fit_model.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "raysfm/camera/model_check.h"
#include "raysfm/camera/model_starts.h"
#include "raysfm/camera/pixel_finder.h"
#include "raysfm/optim/levenberg_marquardt.h"

namespace raysfm {
namespace {

// A pixel and the direction that it sees.
struct Sample {
  Eigen::Vector2d pixel;
  Eigen::Vector3d direction;
};

// Residuals in pixels, two for each sample; `missing`, at each of the two, where the model does not see it.
// Returns how many it sees, none when its numbers cannot be.
int project_all(const CameraModel& model, const std::vector<Sample>& samples, double missing,
                Eigen::VectorXd* residuals) {
  residuals->setConstant(2 * static_cast<Eigen::Index>(samples.size()), missing);
  if (find_problem(model)) return 0;
  return std::visit(
      [&](const auto& m) {
        int seen = 0;
        if constexpr (ProjectiveModel<std::decay_t<decltype(m)>>) {
          for (size_t i = 0; i < samples.size(); ++i) {
            Eigen::Vector2d pixel;
            if (!m.project(samples[i].direction, &pixel)) continue;
            residuals->segment<2>(2 * static_cast<Eigen::Index>(i)) = pixel - samples[i].pixel;
            ++seen;
          }
        }
        return seen;
      },
      model);
}

// What levenberg_marquardt() minimises. Derivatives are central differences.
class ModelProblem {
 public:
  ModelProblem(const ModelStart& start, const std::vector<Sample>& samples, double missing)
      : start_(start), samples_(samples), missing_(missing), numbers_(model_numbers(start.model)) {
    for (size_t i = 0; i < start.scales.size(); ++i) {
      if (start.scales[i] > 0) free_.push_back(i);
    }
  }

  CameraModel model() const { return model_with(numbers_); }

  double linearize() {
    constexpr double kStep = 1e-6;  // of the number's scale
    const Eigen::Index n = static_cast<Eigen::Index>(free_.size());
    Eigen::VectorXd residuals, plus, minus;
    project_all(model(), samples_, missing_, &residuals);
    Eigen::MatrixXd jacobian(residuals.size(), n);
    for (Eigen::Index c = 0; c < n; ++c) {
      const double h = kStep * start_.scales[free_[c]];
      std::vector<double> moved = numbers_;
      moved[free_[c]] = numbers_[free_[c]] + h;
      project_all(model_with(moved), samples_, missing_, &plus);
      moved[free_[c]] = numbers_[free_[c]] - h;
      project_all(model_with(moved), samples_, missing_, &minus);
      jacobian.col(c) = (plus - minus) / (2 * kStep);
    }
    // A sample that comes or goes within the step has no derivative.
    for (Eigen::Index r = 0; r < jacobian.rows(); ++r) {
      if (!(jacobian.row(r).cwiseAbs().maxCoeff() < missing_ / (4 * kStep))) jacobian.row(r).setZero();
    }
    normal_ = jacobian.transpose() * jacobian;
    gradient_ = jacobian.transpose() * residuals;
    return cost_ = 0.5 * residuals.squaredNorm();
  }

  LmStep solve(double lambda) {
    Eigen::MatrixXd damped = normal_;
    damped.diagonal() += lambda * normal_.diagonal() + Eigen::VectorXd::Constant(normal_.rows(), 1e-12);
    const Eigen::LLT<Eigen::MatrixXd> factors(damped);
    if (factors.info() != Eigen::Success) return {};
    const Eigen::VectorXd step = -factors.solve(gradient_);
    if (!step.allFinite()) return {};
    trial_ = numbers_;
    for (size_t c = 0; c < free_.size(); ++c)
      trial_[free_[c]] += start_.scales[free_[c]] * step[static_cast<Eigen::Index>(c)];
    return {true, -step.dot(gradient_) - 0.5 * step.dot(normal_ * step)};
  }

  LmTrial evaluate(bool linearize_there) {
    Eigen::VectorXd residuals;
    const double before = cost_;
    if (project_all(model_with(trial_), samples_, missing_, &residuals) == 0) return {before, INFINITY};
    const double after = 0.5 * residuals.squaredNorm();
    if (!linearize_there) return {before, after};
    std::swap(numbers_, trial_);
    linearize();
    std::swap(numbers_, trial_);
    return {before, after, true};
  }

  void accept() { numbers_ = trial_; }

 private:
  CameraModel model_with(const std::vector<double>& numbers) const {
    return with_model_numbers(start_.model, numbers);
  }

  const ModelStart& start_;
  const std::vector<Sample>& samples_;
  double missing_;
  std::vector<double> numbers_, trial_;
  std::vector<size_t> free_;
  Eigen::MatrixXd normal_;
  Eigen::VectorXd gradient_;
  double cost_ = 0;
};

// Directions of a grid of pixels, `offset` in [0, 1) of their distance. Pixels next to what sees nothing are
// left out: there a table may have rays that the camera behind it has not. False where a ray does not pass
// the origin.
bool sample(const Camera& camera, double offset, double max_angle, std::vector<Sample>* samples) {
  constexpr int kGrid = 48;
  const Eigen::Vector2d spacing(static_cast<double>(camera.width) / kGrid,
                                static_cast<double>(camera.height) / kGrid);
  for (int i = 0; i < kGrid * kGrid; ++i) {
    const Eigen::Vector2d pixel((i % kGrid + offset) * spacing.x() - 0.5,
                                (i / kGrid + offset) * spacing.y() - 0.5);
    Ray ray, other;
    if (!camera.ray(pixel, &ray)) continue;
    if (ray.direction.cross(ray.origin).norm() > 1e-12) return false;
    bool inside = true;
    for (int n = 0; n < 9 && inside; ++n) {
      const Eigen::Vector2d beside = pixel + spacing.cwiseProduct(Eigen::Vector2d(n % 3 - 1, n / 3 - 1));
      inside = !camera.contains(beside) || camera.ray(beside, &other);
    }
    const double angle = std::atan2(ray.direction.head<2>().norm(), ray.direction.z());
    if (inside && angle < max_angle) samples->push_back({pixel, ray.direction});
  }
  return true;
}

}  // namespace

Result<RayFit> fit_model(const Camera& camera, std::string_view model) {
  if (model == CentralRayTable::kName) return fit_ray_table(camera);
  Eigen::Vector2d axis(0.5 * (camera.width - 1), 0.5 * (camera.height - 1));
  PixelFinder(camera).find(Eigen::Vector3d::UnitZ(), &axis);
  const double focal = camera.pixels_per_radian();
  const std::vector<ModelStart> starts = model_starts(model, focal, axis);
  if (starts.empty()) {
    return bad_input("model " + std::string(model) + ": " + std::string(kModelsWithStart) + " or ray-table");
  }
  std::vector<Sample> samples, others;
  if (!sample(camera, 0.0, starts[0].max_angle, &samples) ||
      !sample(camera, 0.5, starts[0].max_angle, &others)) {
    return bad_input("camera " + camera.name + " (" + std::string(model_name(camera.model)) +
                     "): its rays do not meet in its origin; only a ray-table stands for it");
  }
  if (!(focal > 0) || samples.size() < starts[0].scales.size()) {
    return bad_input("camera " + camera.name + ": too few pixels see anything to fit a model");
  }
  RayFit fit;
  fit.camera = camera;
  double least = INFINITY;
  for (const ModelStart& start : starts) {
    ModelProblem problem(start, samples, std::max(camera.width, camera.height));
    const LmSummary summary = levenberg_marquardt(
        problem, {.max_iterations = 200, .min_relative_decrease = 1e-10, .initial_damping = 1e-3});
    if (!(summary.final_cost < least)) continue;
    least = summary.final_cost;
    fit.camera.model = problem.model();
  }
  double sum = 0;
  for (const Sample& other : others) {
    Eigen::Vector2d pixel;
    if (!fit.camera.project(other.direction, &pixel)) continue;
    ++fit.samples;
    sum += (pixel - other.pixel).squaredNorm();
    fit.max_px = std::max(fit.max_px, (pixel - other.pixel).norm());
  }
  if (fit.samples > 0) fit.rms_px = std::sqrt(sum / fit.samples);
  return fit;
}

}  // namespace raysfm
