#include "raysfm/boards/calibrate_camera.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "raysfm/camera/model_starts.h"
#include "raysfm/camera/observed_ray.h"
#include "raysfm/core/median.h"
#include "raysfm/robust/absolute_pose.h"

namespace raysfm {
namespace {

constexpr double kLooseError =
    0.02;  // of the image's larger side: what a start without distortion may be off
constexpr int kTriedImages = 10, kTriedStarts = 3;

// Where the camera sees a board from, by the rays of its corners; nothing where it cannot be told.
bool pose_board(const Board& board, const Camera& camera, const BoardImage& image, double max_error,
                const Rigid3* prior, PoseEstimator* estimator, PoseEstimate* estimate) {
  std::vector<Eigen::Vector3d> points;
  std::vector<ObservedRay> rays;
  Camera alone = camera;
  alone.rig_from_cam = {};
  for (int i = 0; i < board.corners(); ++i) {
    ObservedRay ray;
    if (!observe_ray(alone, image.pixels[i], AngularWeight::kPixel, &ray)) continue;
    points.push_back(board.corner(i));
    rays.push_back(ray);
  }
  PoseObservations observations;
  observations.points_in_world = points;
  observations.rays = rays;
  PoseOptions options;
  options.max_error_px = max_error;
  options.min_inliers = std::max(4, board.corners() / 2);
  options.max_iterations = 100;
  options.prior_inlier_ratio = 0.99;
  estimator->estimate(Rig{{alone}}, observations, prior, options, estimate);
  return estimate->ok();
}

// Truncated squared residuals of an image's corners from a pose, in units of max_error.
double cost_of_pose(const Board& board, const Camera& camera, const BoardImage& image, const Rigid3& pose,
                    double max_error) {
  double cost = 0;
  for (int i = 0; i < board.corners(); ++i) {
    Eigen::Vector2d pixel;
    const bool seen = camera.project(pose * board.corner(i), &pixel);
    cost += seen ? std::min(1.0, (pixel - image.pixels[i]).squaredNorm() / (max_error * max_error)) : 1.0;
  }
  return cost;
}

// A camera to start from, and how badly it explains some of the images.
struct Trial {
  CameraModel model;
  std::vector<double> scales;
  double cost = 0;
};

// How far the corners of an image are from where the camera sees them; infinite where it does not.
struct ImageErrors {
  const BoardImage* image;
  int view;
  std::vector<double> lengths;
  double middle;  // their median
};

ImageErrors errors_of(const BoardProblem& problem, int view, const BoardImage& image) {
  ImageErrors errors{&image, view, {}, 0};
  for (int i = 0; i < problem.board.corners(); ++i) {
    Eigen::Vector2d residual;
    const bool seen = board_residual(problem, {view, image.camera, i, image.pixels[i]}, &residual);
    errors.lengths.push_back(seen ? residual.norm() : std::numeric_limits<double>::infinity());
  }
  std::vector<double> copy = errors.lengths;
  errors.middle = median_of(&copy);
  return errors;
}

class CameraCalibration {
 public:
  CameraCalibration(const Board& board, const Camera& camera, std::span<const BoardImage> images)
      : camera_(camera), images_(images), size_(std::max(camera.width, camera.height)) {
    problem_.board = board;
    for (const BoardImage& image : images) {
      views_.push_back({image});
      views_.back()[0].camera = 0;
    }
  }

  Result<BoardProblem> run(std::string_view model, std::vector<std::string>* left_out) {
    const std::vector<Trial> trials = ranked_trials(model);
    if (trials.empty()) {
      return bad_input(fmt::format("--model = '{}': allowed: {}", model, kModelsWithStart));
    }
    double least = std::numeric_limits<double>::infinity();
    BoardProblem best;
    for (size_t t = 0; t < std::min<size_t>(kTriedStarts, trials.size()); ++t) {
      const double cost = adjust_robustly(trials[t]);
      if (cost < least) best = problem_, least = cost;
    }
    problem_ = std::move(best);
    if (!std::isfinite(least)) return not_found();
    constexpr int kRounds = 4;
    for (int round = 0; round < kRounds; ++round) {
      pose_again();
      left_out->clear();
      keep_agreeing(views_, &problem_, left_out);
      if (static_cast<int>(images_.size() - left_out->size()) < kMinBoardViews) return not_found();
      adjust_boards({}, 200, &problem_);
    }
    return problem_;
  }

 private:
  Error not_found() const {
    return no_reconstruction(
        fmt::format("{}: the corners of fewer than {} of {} images agree with one camera: the board is not "
                    "flat, its corners were mistaken, or the model does not fit the lens",
                    camera_.name, kMinBoardViews, images_.size()));
  }

  // By how well they explain some of the images, the best first.
  std::vector<Trial> ranked_trials(std::string_view model) {
    constexpr std::array kFocals = {0.12, 0.16, 0.21, 0.28, 0.37, 0.5, 0.66, 0.88,
                                    1.2,  1.6,  2.1,  2.8,  3.7,  5.0, 7.0};  // of the larger side
    const Eigen::Vector2d axis(0.5 * (camera_.width - 1), 0.5 * (camera_.height - 1));
    const size_t step = 1 + (images_.size() - 1) / kTriedImages;
    std::vector<Trial> trials;
    for (const double focal : kFocals) {
      for (ModelStart& start : model_starts(model, focal * size_, axis)) {
        hold_what_poses_take_up(&start);
        Trial& trial = trials.emplace_back(Trial{start.model, std::move(start.scales)});
        Camera camera = camera_;
        camera.model = trial.model;
        for (size_t i = 0; i < images_.size(); i += step) trial.cost += cost_of_image(camera, images_[i]);
      }
    }
    std::stable_sort(trials.begin(), trials.end(),
                     [](const Trial& a, const Trial& b) { return a.cost < b.cost; });
    return trials;
  }

  double cost_of_image(const Camera& camera, const BoardImage& image) {
    const double max_error = kLooseError * size_;
    PoseEstimate estimate;
    if (!pose_board(problem_.board, camera, image, max_error, nullptr, &estimator_, &estimate)) {
      return problem_.board.corners();
    }
    return cost_of_pose(problem_.board, camera, image, estimate.rig_from_world, max_error);
  }

  // A turn of the sensor about the axis, and one of the panorama about the vertical, are turns of the camera.
  static void hold_what_poses_take_up(ModelStart* start) {
    if (std::holds_alternative<OCam>(start->model)) start->scales[3] = 0;
    if (std::holds_alternative<Equirectangular>(start->model)) start->scales[2] = 0;
  }

  // From a trial, all images; the cost under a robust loss, infinite where too few images have a pose.
  double adjust_robustly(const Trial& trial) {
    Camera camera = camera_;
    camera.model = trial.model;
    camera.rig_from_cam = {};
    problem_.rig.cameras = {camera};
    problem_.scales = {trial.scales};
    problem_.rig_from_board.assign(images_.size(), Rigid3{});
    problem_.observations.clear();
    int posed = 0;
    double unposed_cost = 0;
    const RobustLoss loss{RobustLoss::Kind::kCauchy, 2.0};
    for (size_t v = 0; v < images_.size(); ++v) {
      PoseEstimate estimate;
      if (!pose_board(problem_.board, camera, images_[v], kLooseError * size_, nullptr, &estimator_,
                      &estimate)) {
        unposed_cost += 0.5 * problem_.board.corners() * loss.cost(size_ * size_);
        continue;
      }
      ++posed;
      problem_.rig_from_board[v] = estimate.rig_from_world;
      observe_all(static_cast<int>(v));
    }
    if (posed < kMinBoardViews) return std::numeric_limits<double>::infinity();
    adjust_boards({RobustLoss::Kind::kHuber, 2.0}, 50, &problem_);
    pose_again();
    return adjust_boards(loss, 100, &problem_).final_cost + unposed_cost;
  }

  void observe_all(int view) {
    for (int i = 0; i < problem_.board.corners(); ++i) {
      problem_.observations.push_back({view, 0, i, images_[view].pixels[i]});
    }
  }

  // Poses found anew where that explains more: of the two that look alike from afar, a start may take the
  // wrong one.
  void pose_again() {
    const Camera& camera = problem_.rig.cameras[0];
    for (size_t v = 0; v < images_.size(); ++v) {
      PoseEstimate estimate;
      Rigid3& pose = problem_.rig_from_board[v];
      if (!pose_board(problem_.board, camera, images_[v], 3.0, nullptr, &estimator_, &estimate)) continue;
      const auto cost = [&](const Rigid3& p) {
        return cost_of_pose(problem_.board, camera, images_[v], p, 3.0);
      };
      if (cost(estimate.rig_from_world) < cost(pose)) pose = estimate.rig_from_world;
    }
  }

  const Camera& camera_;
  const std::span<const BoardImage> images_;
  const double size_;
  std::vector<BoardView> views_;
  PoseEstimator estimator_;
  BoardProblem problem_;
};

}  // namespace

Result<BoardProblem> calibrate_camera(const Board& board, const Camera& camera, std::string_view model,
                                      std::span<const BoardImage> images,
                                      std::vector<std::string>* left_out) {
  return CameraCalibration(board, camera, images).run(model, left_out);
}

void keep_agreeing(std::span<const BoardView> views, BoardProblem* problem,
                   std::vector<std::string>* left_out) {
  constexpr double kLeastLimit = 0.5, kDeviations = 6;  // pixels, standard deviations
  constexpr double kMostBad = 0.3;                      // of the corners of an image
  constexpr double kWorse = 3;                          // than the middle one of the images
  constexpr double kMedianOfLength = 1.1774;            // of a vector of two normal numbers of unit variance
  std::vector<ImageErrors> errors;
  std::vector<double> all, middles;
  for (int v = 0; v < static_cast<int>(views.size()); ++v) {
    for (const BoardImage& image : views[v]) {
      const ImageErrors& one = errors.emplace_back(errors_of(*problem, v, image));
      all.insert(all.end(), one.lengths.begin(), one.lengths.end());
      middles.push_back(one.middle);
    }
  }
  const double limit = std::max(kLeastLimit, kDeviations / kMedianOfLength * median_of(&all));
  const double middle_limit = std::max(kLeastLimit, kWorse * median_of(&middles));
  problem->observations.clear();
  for (const ImageErrors& one : errors) {
    const BoardImage& image = *one.image;
    const auto bad = std::ranges::count_if(one.lengths, [&](double length) { return !(length < limit); });
    if (static_cast<double>(bad) > kMostBad * problem->board.corners()) {
      left_out->push_back(
          fmt::format("{}: {} of {} corners are more than {:.2g} px from where they should be", image.name,
                      bad, problem->board.corners(), limit));
      continue;
    }
    if (!(one.middle < middle_limit)) {
      left_out->push_back(
          fmt::format("{}: corners are {:.2g} px from where they should be, {} times what is usual",
                      image.name, one.middle, kWorse));
      continue;
    }
    for (int i = 0; i < problem->board.corners(); ++i) {
      if (!(one.lengths[i] < limit)) continue;
      problem->observations.push_back({one.view, image.camera, i, image.pixels[i]});
    }
  }
}

double rms_of(const BoardProblem& problem, int camera) {
  double sum = 0;
  int count = 0;
  for (const BoardObservation& o : problem.observations) {
    Eigen::Vector2d residual;
    if (camera >= 0 && o.camera != camera) continue;
    if (!board_residual(problem, o, &residual)) continue;
    sum += residual.squaredNorm();
    ++count;
  }
  return std::sqrt(sum / std::max(1, count));
}

}  // namespace raysfm
