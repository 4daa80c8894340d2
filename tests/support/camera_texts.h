#pragma once

#include <string>
#include <vector>

#include "support/wide_camera_texts.h"

namespace raysfm::testing_support {

// Small camera files, one of each format that is read.

inline const std::string kProjectYaml = R"(raysfm_camera: 1
cameras:
  - name: left
    model: radtan
    resolution: [640, 480]
    intrinsics: {fx: 500, fy: 501, cx: 320.5, cy: 240.25, k1: -0.1, k2: 0.02, p1: 0.001, p2: -0.002}
  - name: right
    model: pinhole
    resolution: [320, 240]
    intrinsics: {fx: 400, fy: 400, cx: 159.5, cy: 119.5}
    stream: 1
    roi: [10, 20, 320, 240]
    rig_from_cam: {rotation: [0, 0, 0.6, 0.8], translation: [0.1, 0.2, 0.3]}
)";

inline const std::string kKalibrYaml = R"(cam0:
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0002, 0.00002]
  distortion_model: radtan
  intrinsics: [458.654, 457.296, 367.215, 248.375]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.11]
  - [0.0, 0.0, -1.0, 0.01]
  - [0.0, 1.0, 0.0, 0.02]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_model: none
  distortion_coeffs: []
  intrinsics: [457.587, 456.134, 379.999, 255.238]
  resolution: [752, 480]
cam2:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.2]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_model: none
  intrinsics: [457.587, 456.134, 379.999, 255.238]
  resolution: [752, 480]
)";

inline const std::string kOpenVinsYaml = R"(%YAML:1.0 # the header that OpenCV wants

cam0:
  T_imu_cam:
    - [0.0, -1.0, 0.0, -0.02]
    - [1.0, 0.0, 0.0, -0.06]
    - [0.0, 0.0, 1.0, 0.01]
    - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0002, 0.00002]
  distortion_model: radtan
  intrinsics: [458.654, 457.296, 367.215, 248.375] #fu, fv, cu, cv
  resolution: [752, 480]
cam1:
  T_imu_cam:
    - [0.0, -1.0, 0.0, -0.02]
    - [1.0, 0.0, 0.0, 0.05]
    - [0.0, 0.0, 1.0, 0.01]
    - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, -0.0001, -0.00003]
  distortion_model: radtan
  intrinsics: [457.587, 456.134, 379.999, 255.238]
  resolution: [752, 480]
)";

inline const std::string kEurocYaml = R"(# General sensor definitions.
sensor_type: camera
comment: VI-Sensor cam0
T_BS:
  cols: 4
  rows: 4
  data: [0.0, -1.0, 0.0, -0.02,
         1.0, 0.0, 0.0, -0.06,
         0.0, 0.0, 1.0, 0.01,
         0.0, 0.0, 0.0, 1.0]
rate_hz: 20
resolution: [752, 480]
camera_model: pinhole
intrinsics: [458.654, 457.296, 367.215, 248.375]
distortion_model: radial-tangential
distortion_coefficients: [-0.28, 0.07, 0.0002, 0.00002]
)";

inline const std::string kOpenCvYaml = R"(%YAML:1.0
---
calibration_time: "Sat 01 Jan 2000"
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 5.5e+02, 0., 3.2e+02, 0., 5.6e+02, 2.4e+02, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -.25, 1.0e-01, 1.0e-03, -2.0e-03, 5.0e-02 ]
)";

inline const std::string kOpenCvXml = R"(<?xml version="1.0"?>
<opencv_storage>
<!-- a stereo pair -->
<imageSize>640 480</imageSize>
<M1 type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>
  <data>
    550. 0. 320. 0. 560. 240. 0. 0. 1.</data></M1>
<D1 type_id="opencv-matrix"><rows>1</rows><cols>8</cols><dt>d</dt>
  <data>
    0.1 0.2 1e-3 2e-3 0.3 0.15 0.22 0.31</data></D1>
<M2 type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>
  <data>
    551. 0. 321. 0. 561. 241. 0. 0. 1.</data></M2>
<D2 type_id="opencv-matrix"><rows>1</rows><cols>4</cols><dt>d</dt>
  <data>
    -0.1 0.02 1e-3 2e-3</data></D2>
<R type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>
  <data>
    1. 0. 0. 0. 0. -1. 0. 1. 0.</data></R>
<T type_id="opencv-matrix"><rows>3</rows><cols>1</cols><dt>d</dt>
  <data>
    -0.5 0.1 0.2</data></T>
</opencv_storage>
)";

inline const std::string kKittiText =
    "P0: 7.07e+02 0.0e+00 6.01e+02 0.0e+00 0.0e+00 7.08e+02 1.83e+02 0.0e+00 0.0e+00 0.0e+00 1.0e+00 "
    "0.0e+00\n"
    "P1: 7.07e+02 0.0e+00 6.01e+02 -3.535e+02 0.0e+00 7.08e+02 1.83e+02 0.0e+00 0.0e+00 0.0e+00 1.0e+00 "
    "0.0e+00\n"
    "P2: 7.07e+02 0.0e+00 6.01e+02 4.7e+01 0.0e+00 7.08e+02 1.83e+02 1.2e-01 0.0e+00 0.0e+00 1.0e+00 "
    "6.2e-03\n"
    "Tr: 0 -1 0 0 0 0 -1 -0.08 1 0 0 -0.27\n";

inline const std::string kColmapText =
    "# Camera list with one line of data per camera:\n"
    "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
    "# Number of cameras: 1\n"
    "1 OPENCV 640 480 526.2 527.3 320 240 -0.02 0.01 0.001 -0.002\n";

inline std::vector<std::string> camera_texts() {
  std::vector<std::string> texts = {kProjectYaml, kKalibrYaml, kOpenVinsYaml, kEurocYaml,
                                    kOpenCvYaml,  kOpenCvXml,  kKittiText,    kColmapText};
  for (const std::string& text : wide_camera_texts()) texts.push_back(text);
  return texts;
}

}  // namespace raysfm::testing_support
