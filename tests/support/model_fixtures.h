#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "raysfm/camera/camera.h"

namespace raysfm::testing_support {

// Cameras of every model with an image of 640 x 480 pixels, mostly real calibrations. fixtures<Model>() is
// for the models that numbers describe. `kSeen` is the share of the image's pixels that every one of them
// sees.
template <typename Model>
std::vector<Model> fixtures();

template <typename Model>
inline constexpr double kSeen = 1.0;
template <>
inline constexpr double kSeen<KannalaBrandt> = 0.5;
template <>
inline constexpr double kSeen<Unified> = 0.7;
template <>
inline constexpr double kSeen<DoubleSphere> = 0.9;
template <>
inline constexpr double kSeen<Eucm> = 0.9;
template <>
inline constexpr double kSeen<Mirror> = 0.2;
template <>
inline constexpr double kSeen<Equirectangular> = 0.75;

template <>
inline std::vector<Pinhole> fixtures() {
  return {{526.24, 526.24, 319.5, 239.5}, {615, 480, 300, 260}, {40, 40, 319.5, 239.5}};
}

template <>
inline std::vector<Radtan> fixtures() {
  return {{517.306408, 516.469215, 318.64304, 255.313989, 0.262383, -0.953104, -0.005358, 0.002628, 1.163314},
          {458.654, 457.296, 367.215, 248.375, -0.28340811, 0.07395907, 0.00019359, 1.76187114e-05},
          {526.238, 526.238, 319.5, 239.5, -0.0274262},
          {526.238, 526.238, 319.5, 239.5}};
}

template <>
inline std::vector<Rational> fixtures() {
  return {{610, 605, 322, 241, 12.1, 21.3, 2e-4, -3e-4, 1.6, 12.4, 25.1, 6.2},
          {480, 481, 320, 240, 0.262383, -0.953104, -0.005358, 0.002628, 1.163314}};
}

template <>
inline std::vector<KannalaBrandt> fixtures() {
  return {{276.4850207717928, 278.0310503180516, 314.5836189313042, 240.16980920673427, -0.03149689493503132,
           0.07696336480701078, -0.06608854732019281, 0.019667561645120218},
          {190.97847715128717, 190.9733070521226, 254.93170605935475, 256.8974428996504,
           0.0034823894022493434, 0.0007150348452162257, -0.0020532361418706202, 0.00020293673591811182},
          {100, 95, 319.5, 239.5}};  // sees behind itself, 179.9 degrees off the axis
}

template <>
inline std::vector<Unified> fixtures() {
  return {{800, 790, 321, 238, 0.8, -0.2, 0.05, 1e-3, -5e-4},
          {400, 405, 319, 240, 1.0, 0, 0, 0, 0},
          {420, 420, 315, 245, 1.6, 0.02, -0.01, 1e-4, 2e-4},
          {526, 527, 320, 240, 0, -0.1, 0.01, 0, 0}};
}

template <>
inline std::vector<DoubleSphere> fixtures() {
  return {{349.7560023050409, 348.72454229977037, 365.8944076259, 249.3299556570, -0.2409573942178872,
           0.566996899163044},
          {158.28600034966977, 158.2743455478755, 254.96116578191653, 256.8894394501779, -0.17213086034353243,
           0.5931177593944744},
          {300, 310, 320, 240, 0.3, 0.4}};
}

template <>
inline std::vector<Eucm> fixtures() {
  return {{460.76484651566468, 459.4051018049483, 365.8937161309615, 249.33499869752445, 0.5903365915227143,
           1.127468196965374},
          {191.14799836282189, 191.13150963902818, 254.9585771534443, 256.88154645599448, 0.6291060881178562,
           1.0418067381860868},
          {400, 410, 320, 240, 0.4, 0.9}};
}

template <>
inline std::vector<OCam> fixtures() {
  return {{320.219508388648,
           243.494438476351,
           0.999626131079017,
           -0.0034775192597376,
           0.00385134991673147,
           {209.200757992065, 0, -0.00213741670953883, 4.2203617319086e-06, -1.77146086919594e-08}},
          {319.5, 239.5, 1, 0, 0, {500}}};  // a pinhole
}

template <>
inline std::vector<Equirectangular> fixtures() {
  return {Equirectangular::for_image(640, 480), {110, 120, 300, 250}};
}

template <>
inline std::vector<Mirror> fixtures() {
  const auto mirror = [](double conic, const Eigen::Vector3d& apex, const Eigen::Quaterniond& q) {
    return Mirror::from_parameters({1230, 1225, 319.5, 239.5, 0.1, conic, 0.083, apex.x(), apex.y(), apex.z(),
                                    q.x(), q.y(), q.z(), q.w(), 0.02});
  };
  const Eigen::Quaterniond tilt(Eigen::AngleAxisd(0.05, Eigen::Vector3d(1, 2, 0.3).normalized()));
  return {mirror(0, {0.0025, -0.0015, 0.4}, Eigen::Quaterniond::Identity()),
          mirror(-1, {0.004, 0.002, 0.45}, tilt), mirror(-2.4, {-0.003, 0.001, 0.5}, tilt.inverse())};
}

inline Camera fixture_camera(CameraModel model) {
  Camera camera;
  camera.name = "fixture";
  camera.model = std::move(model);
  camera.width = 640;
  camera.height = 480;
  return camera;
}

// Every 16th pixel of an image of 640 times 480, the borders among them.
template <typename Visit>
void for_each_pixel(Visit visit) {
  for (double v = -0.5; v <= 479.5; v += 16) {
    for (double u = -0.5; u <= 639.5; u += 16) visit(Eigen::Vector2d(u, v));
  }
}

}  // namespace raysfm::testing_support
