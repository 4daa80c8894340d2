#pragma once

#include <algorithm>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "raysfm/camera/camera.h"
#include "raysfm/files/config_field.h"

namespace raysfm {

// Readers of other tools' camera files. `root` is the parsed document; what is wrong with it is reported to
// its problem() and the returned rig is to be ignored then. Fields that say nothing about the cameras are
// skipped. `note`, never null, takes what the user should know though it is no error.

// Kalibr's camchain: cam0, cam1, ... with camera_model pinhole, omni, ds or eucm and distortion_model radtan,
// equidistant, fov or none. The rig is cam0; T_cn_cnm1 takes points from camera n - 1 to camera n. Without
// it, T_cam_imu (points from the IMU to the camera) or its inverse T_imu_cam, as OpenVINS keeps them, gives
// the place of the camera relative to cam0. Camera n sees stream n.
Rig import_kalibr(const ConfigField& root, std::string* note);

// EuRoC's sensor.yaml. The rig is the body: rig_from_cam is T_BS, so that poses compare with the data set's
// truth.
Rig import_euroc(const ConfigField& root, std::string* note);

// OpenCV's FileStorage under the names that its samples and ROS write: camera_matrix and
// distortion_coefficients (also K, D and others), image_width and image_height; stereo with M1, D1, M2, D2,
// R, T (or a rotation vector), where x2 = R x1 + T and the rig is the first camera.
//   perspective   k1 k2 p1 p2 [k3 [k4 k5 k6]]
//   fisheye       k1 k2 k3 k4, where fisheye_model is not 0 or distortion_model says fisheye or equidistant
//   omnidir       k1 k2 p1 p2, where there is xi
// Without R and T only the first camera is read and `note` says so.
Rig import_opencv(const ConfigField& root, std::string* note);

// KITTI odometry's calib.txt: P0 to P3, each K [I | K^-1 p] with points in the frame of camera 0, which is
// the rig. Camera n is stream n; the size of the images is not in the file and stays 0.
Rig import_kitti(std::string_view text, ConfigProblem* problem);

// COLMAP's cameras.txt with one camera, of any model that needs no thin prism. COLMAP counts pixels from the
// corner of the first one: half a pixel is taken off the principal point.
Rig import_colmap(std::string_view text, ConfigProblem* problem, std::string* note);

// COLMAP's rigs.txt with one rig and cameras.txt in the folder of `path`. Cameras see streams in the order of
// rigs.txt, the reference camera first.
Rig import_colmap_rig(std::string_view text, const std::filesystem::path& path, ConfigProblem* problem,
                      std::string* note);

// Basalt's JSON: camera_type pinhole, pinhole-radtan8, kb4, ds, ucm, eucm or fov. The rig is the first
// camera.
Rig import_basalt(const ConfigField& root, std::string* note);

// OCamCalib's calib_results.txt.
Rig import_ocamcalib(std::string_view text, ConfigProblem* problem);

// The omnidirectional data sets' config.yaml: a list `cameras` of OCam polynomials with the pose of each
// camera in the rig (rotation vector, translation). Camera n of the list sees stream n.
Rig import_omnimvs(const ConfigField& root, std::string* note);

// MultiCol-SLAM's InteriorOrientationFisheyeN.yaml.
Rig import_multicol(const ConfigField& root);

// MultiCol-SLAM's MultiCamSys_Calibration.yaml with the InteriorOrientationFisheyeN.yaml of each camera in
// the folder of `path`; rig_from_cam is M_c.
Rig import_multicol_rig(const ConfigField& root, const std::filesystem::path& path);

// Settings of stella_vslam (also in OpenVSLAM's flat form) and of ORB-SLAM2 and 3. Stereo: the rig is the
// left camera. Where the tool rectifies the images itself, the cameras are those of the images as recorded.
Rig import_stella(const ConfigField& root, std::string* note);
Rig import_orbslam(const ConfigField& root, std::string* note);

// Generic models of puzzlepaint's calibration tool: CentralGenericModel and NoncentralGenericModel.
Rig import_generic(const ConfigField& root);

// Pinhole, radtan or rational from the numbers of OpenCV's order fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6, of
// which the absent ones at the end are zero; a pinhole where all coefficients are zero.
CameraModel perspective_model(const std::vector<double>& numbers);

// The model with these numbers in the order of its parameters; the absent ones at the end are zero.
template <typename Model>
Model model_from(const std::vector<double>& numbers) {
  auto parameters = Model{}.parameters();
  parameters.fill(0);
  std::copy_n(numbers.begin(), std::min(numbers.size(), parameters.size()), parameters.begin());
  return Model::from_parameters(parameters);
}

// The division model, r_undistorted = r / (1 + k r^2) in normalised coordinates: exactly eucm with alpha =
// 1/2 and beta = -4 k. Nullopt for k above 0, which bends in a way that eucm cannot.
std::optional<CameraModel> division_model(double fx, double fy, double cx, double cy, double k);

// Kannala-Brandt fitted to the FOV model of Devernay and Faugeras, r = f atan(2 tan(theta) tan(omega/2)) /
// omega, over an image of this size (0: unknown, 90 degrees either side); `note` tells the largest
// difference.
CameraModel fov_model(const std::vector<double>& fx_fy_cx_cy_omega, int width, int height,
                      const ConfigField& field, std::string* note);

// Reports focal lengths that are not above 0, numbers beyond any image and models that no camera can have,
// under the name of `field`.
void check_intrinsics(const CameraModel& model, const ConfigField& field);

// Sides of an image, [width, height].
void read_resolution(const ConfigField& field, Camera* camera);

// Adds a sentence to `note`.
void add_note(std::string* note, const std::string& text);

// Names of the models that a camera file can hold, e.g. for messages: "pinhole, radtan, rational".
std::string supported_models();

// Largest width and height of an image.
constexpr int kMaxImageSide = 32768;

}  // namespace raysfm
