#pragma once

#include <string>
#include <vector>

namespace raysfm::testing_support {

// Small camera files beyond perspective cameras, one of each format that is read.

inline const std::string kManyModelsYaml = R"(raysfm_camera: 1
cameras:
  - name: fisheye
    model: kannala-brandt
    resolution: [640, 480]
    intrinsics: {fx: 200, fy: 201, cx: 320, cy: 240, k1: 0.01, k2: -0.002, k3: 0.001, k4: -0.0001}
  - name: omni
    model: unified
    resolution: [640, 480]
    intrinsics: {fx: 600, fy: 601, cx: 320, cy: 240, xi: 1.1, k1: -0.1, k2: 0.01, p1: 0.001, p2: -0.001}
    stream: 1
  - name: spheres
    model: double-sphere
    resolution: [640, 480]
    intrinsics: {fx: 180, fy: 181, cx: 320, cy: 240, xi: -0.2, alpha: 0.57}
    stream: 2
  - name: enhanced
    model: eucm
    resolution: [640, 480]
    intrinsics: {fx: 230, fy: 231, cx: 320, cy: 240, alpha: 0.6, beta: 1.1}
    stream: 3
  - name: polynomial
    model: ocam
    resolution: [640, 480]
    intrinsics: {cx: 321, cy: 239, c: 1.001, d: 0.002, e: -0.003, a0: 200, a1: 0, a2: -0.001, a3: 1e-7}
    stream: 4
  - name: panorama
    model: equirectangular
    resolution: [640, 320]
    stream: 5
  - name: ball
    model: mirror
    resolution: [640, 640]
    intrinsics: {fx: 1640, fy: 1640, cx: 319.5, cy: 319.5}
    mirror: {radius: 0.1, conic: 0, rim: 0.083, apex: [0.0025, -0.0015, 0.4], rotation: [0, 0, 0, 1], body: 0.022}
    stream: 6
  - name: table
    model: ray-table
    resolution: [40, 30]
    table:
      area: [0, 0, 39, 29]
      grid: [4, 4]
      directions: [-1.5, -1.5, 2, -0.5, -1.5, 2, 0.5, -1.5, 2, 1.5, -1.5, 2,
        -1.5, -0.5, 2, -0.5, -0.5, 2, 0.5, -0.5, 2, 1.5, -0.5, 2,
        -1.5, 0.5, 2, -0.5, 0.5, 2, 0.5, 0.5, 2, 1.5, 0.5, 2,
        -1.5, 1.5, 2, -0.5, 1.5, 2, 0.5, 1.5, 2, 1.5, 1.5, 2]
    stream: 7
)";

inline const std::string kKalibrWideYaml = R"(cam0:
  camera_model: omni
  intrinsics: [1.1, 600, 601, 320, 240]
  distortion_model: radtan
  distortion_coeffs: [-0.1, 0.01, 0.001, -0.002]
  resolution: [640, 480]
cam1:
  camera_model: ds
  intrinsics: [-0.2, 0.57, 180, 181, 322, 242]
  distortion_model: none
  distortion_coeffs: []
  resolution: [640, 480]
  T_cn_cnm1: [[1, 0, 0, -0.1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
cam2:
  camera_model: eucm
  intrinsics: [0.6, 1.1, 230, 231, 323, 243]
  distortion_model: none
  distortion_coeffs: []
  resolution: [640, 480]
  T_cn_cnm1: [[1, 0, 0, -0.1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
cam3:
  camera_model: pinhole
  intrinsics: [200, 201, 324, 244]
  distortion_model: equidistant
  distortion_coeffs: [0.01, -0.02, 0.003, -0.0004]
  resolution: [640, 480]
  T_cn_cnm1: [[1, 0, 0, -0.1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
cam4:
  camera_model: pinhole
  intrinsics: [260, 260, 319.5, 239.5]
  distortion_model: fov
  distortion_coeffs: [0.9]
  resolution: [640, 480]
  T_cn_cnm1: [[1, 0, 0, -0.1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
)";

inline const std::string kBasaltJson = R"({"value0": {
  "T_imu_cam": [{"px": 0.01, "py": 0.02, "pz": 0.03, "qx": 0, "qy": 0, "qz": 0.6, "qw": 0.8},
                {"px": 0.11, "py": 0.02, "pz": 0.03, "qx": 0, "qy": 0, "qz": 0, "qw": 1},
                {"px": 0.21, "py": 0.02, "pz": 0.03, "qx": 0, "qy": 0, "qz": 0, "qw": 1}],
  "intrinsics": [
    {"camera_type": "ds",
     "intrinsics": {"fx": 180, "fy": 181, "cx": 320, "cy": 240, "xi": -0.2, "alpha": 0.57}},
    {"camera_type": "kb4", "intrinsics":
     {"fx": 200, "fy": 201, "cx": 322, "cy": 242, "k1": 0.01, "k2": -0.02, "k3": 0.003, "k4": -0.0004}},
    {"camera_type": "ucm", "intrinsics": {"fx": 230, "fy": 231, "cx": 323, "cy": 243, "alpha": 0.6}}],
  "resolution": [[640, 480], [640, 480], [640, 480]],
  "imu_update_rate": 200.0}}
)";

inline const std::string kOCamCalibText =
    R"(#polynomial coefficients for the DIRECT mapping function (ocam_model.ss in MATLAB)

5 -2.0e+02 0.0 1.0e-03 -1.0e-06 2.0e-09

#polynomial coefficients for the inverse mapping function (ocam_model.invpol in MATLAB)

3 300 150 -10

#center: "row" and "column", starting from 0 (C convention)

238.5 322.25

#affine parameters "c", "d", "e"

1.001 0.002 -0.003

#image size: "height" and "width"

480 640
)";

inline const std::string kOmniMvsYaml = R"(cameras:
  - cam_id: 1
    model: ocam
    poly: [5, -200.0, 0.0, 1.0e-03, -1.0e-06, 2.0e-09]
    inv_poly: [3.0, 300, 150, -10]
    center: [238.5, 322.25]
    affine: [1.001, 0.002, -0.003]
    image_size: [480, 640]
    pose: [0, 1.5707963267948966, 0, 0.1, 0.2, 0.3]
)";

// Without the space behind a colon, as OpenCV's reader allows.
inline const std::string kMultiColYaml = R"(%YAML:1.0
Camera.Iw: 640
Camera.Ih: 480
Camera.nrpol: 5
Camera.nrinvpol: 2
Camera.a0:-200.0
Camera.a1: 0.0
Camera.a2: 0.001
Camera.a3: -1.0e-06
Camera.a4: 2.0e-09
Camera.pol0: 300
Camera.pol1:-150
Camera.c: 0.999
Camera.d: -0.012
Camera.e: 0.0126
Camera.u0: 322.25
Camera.v0: 238.5
)";

inline const std::string kStellaYaml = R"(Camera:
  name: "wide"
  setup: "monocular"
  model: "fisheye"
  fx: 441.5
  fy: 442.5
  cx: 480.25
  cy: 275.75
  k1: -3.0e-02
  k2: -3.3e-03
  k3: -2.8e-03
  k4: -5.9e-04
  fps: 30.0
  cols: 960
  rows: 540
Feature:
  name: "x"
)";

inline const std::string kOrbSlamYaml = R"(%YAML:1.0
File.version: "1.0"
Camera.type: "KannalaBrandt8"
Camera1.fx: 190.97
Camera1.fy: 190.98
Camera1.cx: 254.93
Camera1.cy: 256.89
Camera1.k1: 0.0034
Camera1.k2: 0.0007
Camera1.k3: -0.002
Camera1.k4: 0.0002
Camera2.fx: 190.44
Camera2.fy: 190.43
Camera2.cx: 252.59
Camera2.cy: 254.91
Camera2.k1: 0.0034
Camera2.k2: 0.0017
Camera2.k3: -0.0026
Camera2.k4: 0.0003
Stereo.T_c1_c2: !!opencv-matrix
  rows: 4
  cols: 4
  dt: f
  data: [1.0, 0, 0, 0.1, 0, 0, -1.0, 0.2, 0, 1.0, 0, 0.3, 0, 0, 0, 1.0]
Camera.width: 512
Camera.height: 512
Camera.fps: 20
)";

inline const std::string kGenericYaml = R"(type : NoncentralGenericModel
width : 40
height : 30
calibration_min_x : 0
calibration_min_y : 0
calibration_max_x : 39
calibration_max_y : 29
grid_width : 4
grid_height : 4
# Each grid point is stored as x, y, z.
point_grid : [0, 0, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0, 0, 0, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0,
  0, 0, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0, 0, 0, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0]
direction_grid : [-1.5, -1.5, 2, -0.5, -1.5, 2, 0.5, -1.5, 2, 1.5, -1.5, 2,
  -1.5, -0.5, 2, -0.5, -0.5, 2, 0.5, -0.5, 2, 1.5, -0.5, 2,
  -1.5, 0.5, 2, -0.5, 0.5, 2, 0.5, 0.5, 2, 1.5, 0.5, 2,
  -1.5, 1.5, 2, -0.5, 1.5, 2, 0.5, 1.5, 2, 1.5, 1.5, 2]
)";

inline const std::string kOpenCvFisheyeYaml = R"(%YAML:1.0
---
image_width: 640
image_height: 480
fisheye_model: 1
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 200., 0., 320., 0., 201., 240., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 4
   cols: 1
   dt: d
   data: [ 0.01, -0.02, 0.003, -0.0004 ]
)";

inline const std::string kOpenCvOmniYaml = R"(%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix_1: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 600., 0., 320., 0., 601., 240., 0., 0., 1. ]
distortion_coefficients_1: !!opencv-matrix
   rows: 1
   cols: 4
   dt: d
   data: [ -0.1, 0.01, 0.001, -0.002 ]
xi_1: 1.1
camera_matrix_2: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 602., 0., 321., 0., 603., 241., 0., 0., 1. ]
distortion_coefficients_2: !!opencv-matrix
   rows: 1
   cols: 4
   dt: d
   data: [ -0.1, 0.01, 0., 0. ]
xi_2: 1.2
om: [ 0., 1.5707963267948966, 0. ]
T: [ 1., 2., 3. ]
)";

inline std::vector<std::string> wide_camera_texts() {
  return {kManyModelsYaml, kKalibrWideYaml, kBasaltJson,  kOCamCalibText,     kOmniMvsYaml,   kMultiColYaml,
          kStellaYaml,     kOrbSlamYaml,    kGenericYaml, kOpenCvFisheyeYaml, kOpenCvOmniYaml};
}

}  // namespace raysfm::testing_support
