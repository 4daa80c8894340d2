#include "raysfm/boards/calibrate_boards.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "raysfm/boards/calibrate_camera.h"
#include "raysfm/boards/rig_start.h"

namespace raysfm {
namespace {

constexpr double kUntold = 0.2;  // standard deviation of a focal length, as a part of it

// The images of one camera, and the view of each.
struct OwnImages {
  std::vector<BoardImage> images;
  std::vector<int> views;
};

OwnImages own_images(std::span<const BoardView> views, int camera) {
  OwnImages own;
  for (size_t v = 0; v < views.size(); ++v) {
    const BoardImage* image = image_of(views[v], camera);
    if (!image) continue;
    own.images.push_back(*image);
    own.views.push_back(static_cast<int>(v));
  }
  return own;
}

// In the model named, or the better of two.
Result<BoardProblem> calibrate_alone(const Board& board, const Camera& camera, const std::string& model,
                                     const std::vector<BoardImage>& images,
                                     std::vector<std::string>* left_out) {
  // Distortion of a perspective lens is what most lenses have: a fisheye must fit clearly better.
  constexpr double kClearly = 0.97;
  if (model != "auto") return calibrate_camera(board, camera, model, images, left_out);
  std::vector<std::string> others;
  Result<BoardProblem> radtan = calibrate_camera(board, camera, Radtan::kName, images, left_out);
  Result<BoardProblem> fisheye = calibrate_camera(board, camera, KannalaBrandt::kName, images, &others);
  if (!fisheye) return radtan;
  const bool more = radtan && fisheye->observations.size() > 1.02 * radtan->observations.size();
  const bool fewer = radtan && radtan->observations.size() > 1.02 * fisheye->observations.size();
  if (radtan && !more && (fewer || rms_of(*fisheye) > kClearly * rms_of(*radtan))) return radtan;
  *left_out = std::move(others);
  return fisheye;
}

// The views of one camera's problem numbered as those of all.
BoardProblem renumbered(BoardProblem problem, const std::vector<int>& views, size_t count) {
  std::vector<Rigid3> poses(count);
  for (size_t i = 0; i < views.size(); ++i) poses[views[i]] = problem.rig_from_board[i];
  problem.rig_from_board = std::move(poses);
  for (BoardObservation& o : problem.observations) o.view = views[o.view];
  return problem;
}

Error untold(const BoardCalibration& calibration, int camera) {
  const double sigma = calibration.sigmas.focal[camera];
  const std::string by = std::isfinite(sigma) ? fmt::format("within {:.0f} %", 100 * sigma) : "at all";
  return no_reconstruction(
      fmt::format("{}: the focal length is not told {}: all views show the board alike; allowed: the board "
                  "tilted by 20 degrees and more against the image, to different sides",
                  calibration.problem.rig.cameras[camera].name, by));
}

// All cameras together, from where they stand; what does not agree is left out.
void adjust_together(std::span<const BoardView> views, BoardCalibration* calibration) {
  BoardProblem& problem = calibration->problem;
  problem.observations.clear();
  for (size_t v = 0; v < views.size(); ++v) {
    for (const BoardImage& image : views[v]) {
      for (int i = 0; i < problem.board.corners(); ++i) {
        problem.observations.push_back({static_cast<int>(v), image.camera, i, image.pixels[i]});
      }
    }
  }
  adjust_boards({RobustLoss::Kind::kCauchy, 2.0}, 100, &problem);
  constexpr int kRounds = 3;
  for (int round = 0; round < kRounds; ++round) {
    calibration->left_out.clear();
    keep_agreeing(views, &problem, &calibration->left_out);
    adjust_boards({}, 200, &problem);
  }
}

}  // namespace

Result<BoardCalibration> calibrate_boards(const Board& board, std::span<const Camera> cameras,
                                          const std::string& model, std::vector<BoardView> views) {
  BoardCalibration calibration;
  std::vector<BoardProblem> alone;
  for (int c = 0; c < static_cast<int>(cameras.size()); ++c) {
    const OwnImages own = own_images(views, c);
    if (static_cast<int>(own.images.size()) < kMinBoardViews) {
      return bad_input(fmt::format("{}: {} different views of the board; allowed: at least {}, better 15",
                                   cameras[c].name, own.images.size(), kMinBoardViews));
    }
    std::vector<std::string> left_out;
    Result<BoardProblem> one = calibrate_alone(board, cameras[c], model, own.images, &left_out);
    if (!one) return one.error();
    calibration.alone_rms_px.push_back(rms_of(*one));
    calibration.left_out.insert(calibration.left_out.end(), left_out.begin(), left_out.end());
    alone.push_back(renumbered(*std::move(one), own.views, views.size()));
  }
  calibration.problem = alone[0];
  if (cameras.size() > 1) {
    Result<BoardProblem> together = start_rig(alone, &views);
    if (!together) return together.error();
    calibration.problem = *std::move(together);
    adjust_together(views, &calibration);
  }
  calibration.sigmas = board_sigmas(calibration.problem);
  calibration.rms_px = rms_of(calibration.problem);
  for (int c = 0; c < static_cast<int>(cameras.size()); ++c) {
    calibration.camera_rms_px.push_back(rms_of(calibration.problem, c));
    if (!(calibration.sigmas.focal[c] < kUntold)) return untold(calibration, c);
  }
  return calibration;
}

}  // namespace raysfm
