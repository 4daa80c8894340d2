#pragma once

#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

#include "raysfm/boards/board.h"
#include "raysfm/camera/camera.h"
#include "raysfm/geometry/pose.h"
#include "raysfm/optim/levenberg_marquardt.h"
#include "raysfm/optim/robust_loss.h"

namespace raysfm {

// A corner of the board seen by a camera at an instant.
struct BoardObservation {
  int view = 0;  // the instant
  int camera = 0;
  int corner = 0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
};

// Cameras of a rig and where it stood before the board: the unknowns, and what they are found from.
struct BoardProblem {
  Board board;
  Rig rig;
  // Of the numbers of each camera's model: how much of each matters, 0 for those that stay (ModelStart).
  std::vector<std::vector<double>> scales;
  std::vector<Rigid3> rig_from_board;  // one for each view
  std::vector<BoardObservation> observations;
};

// Residual of an observation, predicted minus observed, pixels; false where the camera does not see the
// corner.
bool board_residual(const BoardProblem& problem, const BoardObservation& observation,
                    Eigen::Vector2d* residual);

// Finds the numbers of the models, the poses of all cameras in the rig but the first, and those of the board,
// by Levenberg-Marquardt: least squares of the residuals under the loss. Derivatives by the numbers of the
// models are central differences, so that any model that projects will do.
LmSummary adjust_boards(const RobustLoss& loss, int max_iterations, BoardProblem* problem);

// How sure the numbers of the cameras are.
struct BoardSigmas {
  // Of each camera: standard deviations of the numbers of the model, 0 for those that stay, infinite where
  // nothing tells them.
  std::vector<std::vector<double>> numbers;
  // Of each camera: of the pixels per radian near the middle of the image, as a part of them. Where numbers
  // of a model make up for one another, as the focal length and xi do, this is what the views tell.
  std::vector<double> focal;
  // Of cam_from_rig, in the camera's frame, see retract(); zero for the first camera.
  std::vector<Eigen::Matrix<double, 6, 1>> pose;
};

// Standard deviations at the minimum: the larger of two. What the normal equations say, scaled by the
// residuals; and the jackknife over the views, each left out in turn, linearised: corners of one image share
// errors (the board is not flat, the image blurred, the lens no such model), so that there are as many
// independent observations as images, and not as many as corners.
BoardSigmas board_sigmas(const BoardProblem& problem);

}  // namespace raysfm
