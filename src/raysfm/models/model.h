#pragma once

#include <Eigen/Core>
#include <array>
#include <concepts>
#include <string_view>

#include "raysfm/geometry/ray.h"

namespace raysfm {

// What a camera model is. A new model is one header that satisfies the concepts below and one line in
// CameraModel (camera.h); the camera file, the property tests and the fuzz tests then know it.
// docs/adding-a-camera.md goes through the steps.
//
// Every model has a name, kName, that of the camera file, and is either central or non-central. It may be
// projective, and is mostly parametric.
template <typename Model>
concept NamedModel = requires {
  { Model::kName } -> std::convertible_to<std::string_view>;
};

// A model that some numbers describe.
//
// kParameterNames   names in the camera file, in the order of parameters(). "fx" stands in `intrinsics`,
//                   "mirror.radius" is `radius` in the map `mirror` beside it, "mirror.apex[0]" the first
//                   element of the list `apex` there
// kRequired         the first kRequired of them must be in the file, the others default to those of
//                   default_model()
// from_parameters() the model with these numbers, whatever they are: see find_problem() in model_check.h
//
// Optional, found by default_model() and find_problem():
//   static Model for_image(int width, int height)      what a file that names no numbers means
//   std::optional<ParameterProblem> problem() const    the first of its parameters that cannot be
template <typename Model>
concept ParametricModel = NamedModel<Model> && requires(const Model& model) {
  { Model::kRequired } -> std::convertible_to<size_t>;
  { Model::kParameterNames.size() } -> std::convertible_to<size_t>;
  { Model::from_parameters(model.parameters()) } -> std::same_as<Model>;
};

// All rays of a central model pass the origin of the camera's frame: a pixel has a direction of unit length.
// unproject() is false where the pixel sees nothing.
template <typename Model>
concept CentralModel = NamedModel<Model> &&
    requires(const Model& model, const Eigen::Vector2d& pixel, Eigen::Vector3d* direction) {
  { model.unproject(pixel, direction) } -> std::same_as<bool>;
};

// Each pixel of a non-central model has its own origin as well. The ray is in the camera's frame.
template <typename Model>
concept NonCentralModel = NamedModel<Model> &&
    requires(const Model& model, const Eigen::Vector2d& pixel, Ray* ray) {
  { model.ray(pixel, ray) } -> std::same_as<bool>;
};

// A model that can project: point in the camera's frame to pixel. project() is false outside the valid set
// and leaves its outputs unspecified then. `jacobian` is d pixel / d point, or null.
template <typename Model>
concept ProjectiveModel = NamedModel<Model> &&
    requires(const Model& model, const Eigen::Vector3d& point, Eigen::Vector2d* pixel,
             Eigen::Matrix<double, 2, 3>* jacobian) {
  { model.project(point, pixel, jacobian) } -> std::same_as<bool>;
};

// Ray of a pixel in the camera's frame, whatever the model; false where the pixel sees nothing.
template <typename Model>
requires CentralModel<Model> || NonCentralModel<Model>
bool model_ray(const Model& model, const Eigen::Vector2d& pixel, Ray* ray) {
  if constexpr (CentralModel<Model>) {
    ray->origin.setZero();
    return model.unproject(pixel, &ray->direction);
  } else {
    return model.ray(pixel, ray);
  }
}

// The model that a camera file means which gives none of its numbers, for an image of that size.
template <ParametricModel Model>
Model default_model(int width, int height) {
  if constexpr (requires { Model::for_image(width, height); }) {
    return Model::for_image(width, height);
  } else {
    return Model{};
  }
}

// A parameter that cannot be: its name in kParameterNames, its value and what is allowed.
struct ParameterProblem {
  std::string_view name;
  double value = 0;
  std::string_view allowed;
};

}  // namespace raysfm
