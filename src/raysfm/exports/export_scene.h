#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// Where an image sees a point of the map.
struct ExportKeypoint {
  int point = 0;  // index into ExportScene::points
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
};

// An image of one camera with its pose.
struct ExportImage {
  int frame = 0;     // index into Reconstruction::frames
  int camera = 0;    // index into ExportScene::cameras
  std::string name;  // of the file, below the folder of images
  Rigid3 world_from_cam;
  std::vector<ExportKeypoint> keypoints;
};

// One world as formats of images with cameras and points see it.
struct ExportScene {
  bool rig = false;                 // the cameras are one rig, all of which see every frame; else lenses
  std::vector<Camera> cameras;      // rig_from_cam is the identity of lenses
  std::vector<double> skews;        // of each camera; pixels, K(0, 1): no camera model has it
  std::vector<ExportImage> images;  // in the order of frames, then of cameras
  std::vector<MapPoint> points;
};

// The key frames of a world, or all its frames with a pose, of which only key frames have keypoints. Images
// of several cameras are called "<camera>/<image>"; frames of which no name is known "frame-000012". Lenses
// that no image has are left out. Errors: bad input, where an image has no camera or leads out of its folder.
Result<ExportScene> make_export_scene(const Reconstruction& world, bool all_frames);

// The images with names that end in .png, as many as before.
void name_as_png(ExportScene* scene);

// Mean distance in pixels between the keypoints of each point and its projections; -1 of points that no
// camera without skew sees.
std::vector<double> point_errors(const ExportScene& scene);

}  // namespace raysfm
