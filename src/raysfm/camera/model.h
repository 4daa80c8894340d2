#pragma once

#include <Eigen/Core>
#include <array>
#include <concepts>
#include <string_view>

#include "raysfm/geometry/ray.h"

namespace raysfm {

// What every camera model is. A new model is one header that satisfies one of the concepts below and one line
// in CameraModel (camera.h); the camera file, the property tests and the fuzz tests then know it.
//
// kName             name in the camera file
// kParameterNames   names in the camera file, in the order of parameters()
// kRequired         the first kRequired of them must be in the file, the others default to zero
// from_parameters() the model with these numbers
template <typename Model>
concept NamedModel = requires(const Model& model) {
  { Model::kName } -> std::convertible_to<std::string_view>;
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

}  // namespace raysfm
