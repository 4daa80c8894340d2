#pragma once

#include <string_view>
#include <vector>

#include "raysfm/camera/camera.h"
#include "raysfm/io/config_field.h"

namespace raysfm {

// Readers of other tools' camera files. `root` is the parsed document; what is wrong with it is reported to
// its problem() and the returned rig is to be ignored then. Fields that say nothing about the cameras are
// skipped.

// Kalibr's camchain: cam0, cam1, ... with camera_model pinhole and distortion_model radtan or none. The rig
// is cam0; T_cn_cnm1 takes points from camera n - 1 to camera n. Without it, T_cam_imu (points from the IMU
// to the camera) or its inverse T_imu_cam, as OpenVINS keeps them, gives the place of the camera relative to
// cam0. Camera n sees stream n.
Rig import_kalibr(const ConfigField& root);

// EuRoC's sensor.yaml. The rig is the body: rig_from_cam is T_BS, so that poses compare with the data set's
// truth.
Rig import_euroc(const ConfigField& root);

// OpenCV's FileStorage under the names that its samples and ROS write: camera_matrix and
// distortion_coefficients (also K, D and others), image_width and image_height; stereo with M1, D1, M2, D2,
// R, T, where x2 = R x1 + T and the rig is the first camera. Coefficients k1 k2 p1 p2 [k3 [k4 k5 k6]].
// Without R and T only the first camera is read and `note` says so.
Rig import_opencv(const ConfigField& root, std::string* note);

// KITTI odometry's calib.txt: P0 to P3, each K [I | K^-1 p] with points in the frame of camera 0, which is
// the rig. Camera n is stream n; the size of the images is not in the file and stays 0.
Rig import_kitti(std::string_view text, ConfigProblem* problem);

// COLMAP's cameras.txt with one camera: SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV.
// COLMAP counts pixels from the corner of the first one: half a pixel is taken off the principal point.
Rig import_colmap(std::string_view text, ConfigProblem* problem);

// Pinhole, radtan or rational from the numbers of OpenCV's order fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6, of
// which the absent ones at the end are zero; a pinhole where all coefficients are zero.
CameraModel perspective_model(const std::vector<double>& numbers);

// Reports focal lengths that are not above 0 or numbers beyond any image, under the name of `field`.
void check_intrinsics(const CameraModel& model, const ConfigField& field);

// Names of the models that a camera file can hold, e.g. for messages: "pinhole, radtan, rational".
std::string supported_models();

// Largest width and height of an image.
constexpr int kMaxImageSide = 32768;

}  // namespace raysfm
