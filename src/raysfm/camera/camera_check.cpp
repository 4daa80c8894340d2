#include "raysfm/camera/camera_check.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "raysfm/camera/camera_class.h"
#include "raysfm/camera/observed_ray.h"
#include "raysfm/camera/pixel_finder.h"

namespace raysfm {
namespace {

constexpr int kGrid = 61;     // samples per axis
constexpr int kSweep = 2000;  // samples along a row, a column, a diagonal
constexpr double kDegrees = 180 / std::numbers::pi;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

double angle(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

// The pixel at (s, t) in [0, 1]^2 of the image, centre of the first pixel to centre of the last.
Eigen::Vector2d pixel_at(const Camera& camera, double s, double t) {
  return {s * (camera.width - 1), t * (camera.height - 1)};
}

// Calls visit(pixel) on a grid over the image, the pixels at the edges included.
template <typename Visit>
void for_each_sample(const Camera& camera, Visit visit) {
  for (int j = 0; j < kGrid; ++j) {
    for (int i = 0; i < kGrid; ++i) {
      visit(pixel_at(camera, i / (kGrid - 1.0), j / (kGrid - 1.0)));
    }
  }
}

// Angle swept by the rays from one pixel to another; what sees nothing is left out.
double swept_deg(const Camera& camera, const Eigen::Vector2d& from, const Eigen::Vector2d& to) {
  double sum = 0;
  bool any = false;
  Eigen::Vector3d last = Eigen::Vector3d::Zero();
  for (int i = 0; i <= kSweep; ++i) {
    Ray ray;
    if (!camera.ray(from + (to - from) * (static_cast<double>(i) / kSweep), &ray)) {
      last.setZero();
      continue;
    }
    if (!last.isZero()) sum += angle(last, ray.direction);
    any |= !last.isZero();
    last = ray.direction;
  }
  return any ? sum * kDegrees : kNan;
}

// Signed rad^2 per px^2 of the rays round a pixel; negative where they are seen mirrored. 0: none.
double solid_angle(const Camera& camera, const Eigen::Vector2d& pixel, const Eigen::Vector3d& direction) {
  Eigen::Matrix<double, 3, 2> by_pixel;
  if (!ray_jacobian(camera, pixel, &by_pixel)) return 0;
  return by_pixel.col(0).cross(by_pixel.col(1)).dot(direction);
}

double pixels_per_degree(double solid_angle) {
  return 1 / (kDegrees * std::sqrt(std::abs(solid_angle)));
}

// Sums over the samples of a camera.
struct Survey {
  int samples = 0, seen = 0, tried = 0, lost = 0, upright = 0, mirrored = 0;
  double nearest_to_centre = std::numeric_limits<double>::infinity();
};

void survey_pixel(const Camera& camera, const PixelFinder& finder, const Eigen::Vector2d& pixel,
                  Survey* survey, CameraFacts* facts) {
  ++survey->samples;
  Ray ray;
  if (!camera.ray(pixel, &ray)) return;
  ++survey->seen;
  facts->max_angle_deg =
      std::fmax(facts->max_angle_deg, angle(Eigen::Vector3d::UnitZ(), ray.direction) * kDegrees);
  for (const double distance : {1.0, 10.0}) {
    Eigen::Vector2d again;
    ++survey->tried;
    if (!finder.find(ray.origin + distance * ray.direction, &again)) {
      ++survey->lost;
      continue;
    }
    facts->round_trip_px = std::fmax(facts->round_trip_px, (again - pixel).norm());
  }
  const double solid = solid_angle(camera, pixel, ray.direction);
  if (solid == 0) return;
  ++(solid > 0 ? survey->upright : survey->mirrored);
  const double density = pixels_per_degree(solid);
  facts->min_pixels_per_degree = std::fmin(facts->min_pixels_per_degree, density);
  facts->max_pixels_per_degree = std::fmax(facts->max_pixels_per_degree, density);
  const double off_centre = (pixel - pixel_at(camera, 0.5, 0.5)).norm();
  if (off_centre < survey->nearest_to_centre) {
    survey->nearest_to_centre = off_centre;
    facts->centre_pixels_per_degree = density;
  }
}

}  // namespace

std::vector<std::pair<std::string_view, double>> camera_parameters(const CameraModel& model) {
  std::vector<std::pair<std::string_view, double>> named;
  std::visit(
      [&]<typename Model>(const Model& m) {
        if constexpr (ParametricModel<Model>) {
          const auto numbers = m.parameters();
          for (size_t i = 0; i < numbers.size(); ++i)
            named.emplace_back(Model::kParameterNames[i], numbers[i]);
        }
      },
      model);
  return named;
}

CameraFacts camera_facts(const Camera& camera) {
  CameraFacts facts;
  facts.max_angle_deg = facts.centre_pixels_per_degree = facts.min_pixels_per_degree =
      facts.max_pixels_per_degree = facts.round_trip_px = kNan;
  facts.fov_horizontal_deg = swept_deg(camera, pixel_at(camera, 0, 0.5), pixel_at(camera, 1, 0.5));
  facts.fov_vertical_deg = swept_deg(camera, pixel_at(camera, 0.5, 0), pixel_at(camera, 0.5, 1));
  facts.fov_diagonal_deg = std::fmax(swept_deg(camera, pixel_at(camera, 0, 0), pixel_at(camera, 1, 1)),
                                     swept_deg(camera, pixel_at(camera, 0, 1), pixel_at(camera, 1, 0)));
  const PixelFinder finder(camera);
  Survey survey;
  for_each_sample(
      camera, [&](const Eigen::Vector2d& pixel) { survey_pixel(camera, finder, pixel, &survey, &facts); });
  facts.valid_share = static_cast<double>(survey.seen) / survey.samples;
  facts.round_trip_failures = survey.tried > 0 ? static_cast<double>(survey.lost) / survey.tried : 0;
  facts.folds = survey.upright > 0 && survey.mirrored > 0;
  facts.mirrored = survey.mirrored > survey.upright;
  facts.central = camera_class(Rig{{camera}}) == CameraClass::kCentral;
  return facts;
}

namespace {

using Warnings = std::vector<std::string>;

// Parameter of this name, or NaN where the model has none.
double parameter(const CameraModel& model, std::string_view name) {
  for (const auto& [known, value] : camera_parameters(model)) {
    if (known == name) return value;
  }
  return kNan;
}

void warn_of_numbers(const Camera& camera, Warnings* out) {
  const double fx = parameter(camera.model, "fx"), fy = parameter(camera.model, "fy");
  const double ratio = fx / fy;
  if (ratio < 0.9 || ratio > 1.1) {
    out->push_back(
        fmt::format("{}: fx / fy = {:.4g}: pixels are seldom so far from square", camera.name, ratio));
  }
  const double cx = parameter(camera.model, "cx"), cy = parameter(camera.model, "cy");
  if (camera.width == 0 || std::isnan(cx) || std::isnan(cy)) return;
  const double off_x = std::abs(cx - 0.5 * (camera.width - 1)) / camera.width;
  const double off_y = std::abs(cy - 0.5 * (camera.height - 1)) / camera.height;
  if (off_x > 0.5 || off_y > 0.5) {
    out->push_back(fmt::format("{}: principal point ({:.6g}, {:.6g}) outside the image of {} x {}",
                               camera.name, cx, cy, camera.width, camera.height));
  } else if (off_x > 0.2 || off_y > 0.2) {
    out->push_back(
        fmt::format("{}: principal point ({:.6g}, {:.6g}) far from the middle of the {} x {} image; "
                    "was the calibration made at another resolution?",
                    camera.name, cx, cy, camera.width, camera.height));
  }
}

void warn_of_rays(const Camera& camera, Warnings* out) {
  const CameraFacts facts = camera_facts(camera);
  if (facts.valid_share < 1) {
    out->push_back(fmt::format("{}: {:.1f} % of the pixels have no ray: the model ends before them",
                               camera.name, 100 * (1 - facts.valid_share)));
  }
  if (facts.folds) {
    out->push_back(fmt::format("{}: the rays fold: neighbouring pixels see in the wrong order", camera.name));
  }
  if (facts.round_trip_failures > 0) {
    out->push_back(fmt::format("{}: {:.1f} % of the rays are not seen again where they point", camera.name,
                               100 * facts.round_trip_failures));
  }
  if (facts.round_trip_px > 0.01) {
    out->push_back(fmt::format("{}: a ray is seen again up to {:.3g} px from its pixel", camera.name,
                               facts.round_trip_px));
  }
  if (facts.min_pixels_per_degree < 0.05 * facts.max_pixels_per_degree) {
    out->push_back(fmt::format("{}: pixels per degree fall from {:.4g} to {:.4g} over the image", camera.name,
                               facts.max_pixels_per_degree, facts.min_pixels_per_degree));
  }
}

}  // namespace

std::vector<std::string> place_warnings(const Rig& rig) {
  Warnings out;
  for (size_t i = 0; i < rig.cameras.size(); ++i) {
    for (size_t j = 0; j < i; ++j) {
      const Camera& a = rig.cameras[j];
      const Camera& b = rig.cameras[i];
      const Rigid3 a_from_b = a.rig_from_cam.inverse() * b.rig_from_cam;
      if (a.stream == b.stream && a.roi.w == 0 && b.roi.w == 0) {
        out.push_back(fmt::format("{}: sees the same images as {}, stream {}", b.name, a.name, a.stream));
      }
      if (a_from_b.translation.norm() < 1e-9 &&
          a_from_b.rotation.angularDistance(Eigen::Quaterniond::Identity()) < 1e-9) {
        out.push_back(fmt::format("{}: stands where {} stands and looks the same way; is its pose missing?",
                                  b.name, a.name));
      } else if (a_from_b.translation.norm() > 50) {
        out.push_back(fmt::format("{}: stands {:.4g} m from {}; are the units metres?", b.name,
                                  a_from_b.translation.norm(), a.name));
      }
    }
  }
  return out;
}

std::vector<std::string> camera_warnings(const Rig& rig) {
  Warnings warnings;
  for (const Camera& camera : rig.cameras) {
    warn_of_numbers(camera, &warnings);
    if (camera.width > 0) warn_of_rays(camera, &warnings);
  }
  for (std::string& warning : place_warnings(rig)) warnings.push_back(std::move(warning));
  return warnings;
}

namespace {

std::string metres(double value, const char* positive, const char* negative) {
  return fmt::format("{:.4g} {}", std::abs(value), value < 0 ? negative : positive);
}

}  // namespace

std::vector<std::string> placements(const Rig& rig) {
  std::vector<std::string> lines;
  for (size_t i = 1; i < rig.cameras.size(); ++i) {
    const Camera& first = rig.cameras.front();
    const Camera& camera = rig.cameras[i];
    const Rigid3 first_from_cam = first.rig_from_cam.inverse() * camera.rig_from_cam;
    const Eigen::Vector3d& t = first_from_cam.translation;
    const Eigen::Vector3d axis = first_from_cam.rotation * Eigen::Vector3d::UnitZ();
    lines.push_back(fmt::format(
        "{} stands {}, {}, {} as {} sees it (metres) and looks {:.4g} deg to the {}, {:.4g} deg {}",
        camera.name, metres(t.x(), "right", "left"), metres(t.y(), "below", "above"),
        metres(t.z(), "in front", "behind"), first.name, std::abs(std::atan2(axis.x(), axis.z())) * kDegrees,
        axis.x() < 0 ? "left" : "right", std::abs(std::asin(std::clamp(axis.y(), -1.0, 1.0))) * kDegrees,
        axis.y() < 0 ? "up" : "down"));
  }
  return lines;
}

namespace {

struct RayPair {
  Eigen::Vector3d a, b;
  double pixels_per_radian;  // of the first camera there
};

std::vector<RayPair> common_rays(const Camera& a, const Camera& b, double scale) {
  std::vector<RayPair> pairs;
  for_each_sample(a, [&](const Eigen::Vector2d& pixel) {
    const Eigen::Vector2d other = (pixel.array() + 0.5) * scale - 0.5;
    Ray ray_a, ray_b;
    if (!a.ray(pixel, &ray_a) || !b.ray(other, &ray_b)) return;
    const double solid = solid_angle(a, pixel, ray_a.direction);
    if (solid == 0) return;
    pairs.push_back({ray_a.direction, ray_b.direction, 1 / std::sqrt(std::abs(solid))});
  });
  return pairs;
}

// Rotation a_from_b of least summed angles: Kabsch, repeated with weights 1 / angle.
Eigen::Matrix3d common_rotation(const std::vector<RayPair>& pairs) {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  for (int iteration = 0; iteration < 30; ++iteration) {
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    for (const RayPair& pair : pairs) {
      const double weight = iteration == 0 ? 1 : 1 / std::max(1e-9, (pair.a - rotation * pair.b).norm());
      sum += weight * pair.a * pair.b.transpose();
    }
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(sum, Eigen::ComputeFullU | Eigen::ComputeFullV);
    Eigen::Vector3d signs(1, 1, (svd.matrixU() * svd.matrixV()).determinant() < 0 ? -1 : 1);
    rotation = svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
  }
  return rotation;
}

}  // namespace

Result<CameraComparison> compare_cameras(const Camera& a, const Camera& b) {
  if (a.width == 0 || b.width == 0) {
    return bad_input("resolution: missing; allowed: cameras whose files say the size of the image");
  }
  const double scale = static_cast<double>(b.width) / a.width;
  if (std::abs(scale * a.height - b.height) > 1) {
    return bad_input(fmt::format("resolution: {} x {}; allowed: {} x {} or a scaled copy of it", b.width,
                                 b.height, a.width, a.height));
  }
  const std::vector<RayPair> pairs = common_rays(a, b, scale);
  if (pairs.size() < 10) {
    return bad_input(fmt::format("{} pixels see something in both; allowed: at least 10 of {}", pairs.size(),
                                 kGrid * kGrid));
  }
  const Eigen::Matrix3d a_from_b = common_rotation(pairs);
  std::vector<double> errors;
  for (const RayPair& pair : pairs) {
    errors.push_back(angle(pair.a, a_from_b * pair.b) * pair.pixels_per_radian);
  }
  std::sort(errors.begin(), errors.end());
  CameraComparison result;
  result.rays = static_cast<int>(pairs.size());
  result.rotation_deg = Eigen::AngleAxisd(a_from_b).angle() * kDegrees;
  result.median_px = errors[errors.size() / 2];
  result.p95_px = errors[errors.size() * 95 / 100];
  result.max_px = errors.back();
  return result;
}

}  // namespace raysfm
