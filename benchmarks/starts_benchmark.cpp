// Starts and poses of rigs of any rays, beside OpenGV's on the same problems. Every trial runs all methods in
// turn; times are processor time. Usage: starts_benchmark [trials, default 100] [seed, default 1]
//
// A start is right when the rotation is within 0.5 degrees and the direction of camera 0's motion within 5,
// times noise / 0.5 px where there is more; and the scale, where it is said to be known, within 30 %.

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <functional>
#include <string>
#include <vector>

#include "raysfm/robust/absolute_pose.h"
#include "raysfm/robust/generic_start.h"
#include "raysfm/robust/rig_search.h"
#include "raysfm/solvers/generalised_p3p.h"
#include "raysfm/solvers/seventeen_point.h"
#include "support/rig_test_scenes.h"

#ifdef RAYSFM_HAVE_OPENGV
#include <opengv/absolute_pose/NoncentralAbsoluteAdapter.hpp>
#include <opengv/absolute_pose/methods.hpp>
#include <opengv/relative_pose/NoncentralRelativeAdapter.hpp>
#include <opengv/relative_pose/methods.hpp>
#include <opengv/sac/Ransac.hpp>
#include <opengv/sac_problems/absolute_pose/AbsolutePoseSacProblem.hpp>
#include <opengv/sac_problems/relative_pose/NoncentralRelativePoseSacProblem.hpp>
#endif

namespace {

using namespace raysfm;
using namespace raysfm::rig_scenes;
using Eigen::Vector3d;

constexpr double kDegree = M_PI / 180;

double processor_us() {
  return 1e6 * static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
}

double quantile(std::vector<double> values, double q) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  return values[static_cast<size_t>(q * (values.size() - 1))];
}

const char* name_of(Kind kind) {
  constexpr const char* kNames[] = {"central", "stereo", "stereo x", "ring of 3", "ring of 4", "mirror"};
  return kNames[static_cast<int>(kind)];
}
const char* name_of(Motion motion) {
  constexpr const char* kNames[] = {"forward", "sideways", "rotation", "translation"};
  return kNames[static_cast<int>(motion)];
}

double max_error(double noise_px) {
  return std::max(1.0, 3 * noise_px);
}

// The rays of a scene's points in one view; the first of each where there are several.
std::vector<Ray> rays_of(const Scene& scene, int view) {
  std::vector<Ray> rays(scene.points_in_rig0.size());
  for (size_t i = scene.rays.size(); i-- > 0;) {
    if (scene.views[i] == view) rays[scene.points[i]] = {scene.rays[i].origin, scene.rays[i].direction};
  }
  return rays;
}

// One method's results over the trials.
struct Tally {
  int right = 0, scale_known = 0, count = 0;
  std::vector<double> times_us, rotations, scales;

  void add(double us, const MotionError& error, double noise_px, bool ok, bool known) {
    const double slack = std::max(1.0, noise_px / 0.5);
    const bool right_scale = !known || std::abs(error.scale - 1) < 0.3;
    const bool hit =
        ok && error.rotation < 0.5 * kDegree * slack && error.direction < 5 * kDegree * slack && right_scale;
    right += hit, ++count;
    scale_known += known;
    times_us.push_back(us);
    if (!hit) return;
    rotations.push_back(error.rotation / kDegree);
    if (known) scales.push_back(std::abs(error.scale - 1));
  }
};

Tally run_ours(const std::vector<Scene>& scenes, GenericStartMethod method, double noise_px) {
  Tally tally;
  for (size_t i = 0; i < scenes.size(); ++i) {
    GenericStartOptions options;
    options.method = method;
    options.max_error = max_error(noise_px);
    options.seed = i;
    const double begin = processor_us();
    const GenericStart start = start_generic(scenes[i].matches(), options);
    const double us = processor_us() - begin;
    tally.add(us, motion_error(scenes[i], start.rig1_from_rig0, start.rig2_from_rig0), noise_px, start.ok(),
              start.scale_known);
  }
  return tally;
}

#ifdef RAYSFM_HAVE_OPENGV
using opengv::sac_problems::relative_pose::NoncentralRelativePoseSacProblem;

// Every ray has a camera of its own, in the rig's axes.
struct OpengvRays {
  opengv::bearingVectors_t bearings0, bearings2;
  std::vector<int> cameras0, cameras2;
  opengv::translations_t offsets;
  opengv::rotations_t rotations;

  OpengvRays(const std::vector<Ray>& rays0, const std::vector<Ray>& rays2) {
    for (size_t i = 0; i < rays0.size(); ++i) {
      cameras0.push_back(static_cast<int>(offsets.size()));
      offsets.push_back(rays0[i].origin);
      cameras2.push_back(static_cast<int>(offsets.size()));
      offsets.push_back(rays2[i].origin);
      bearings0.push_back(rays0[i].direction);
      bearings2.push_back(rays2[i].direction);
    }
    rotations.assign(offsets.size(), opengv::rotation_t::Identity());
  }
  opengv::relative_pose::NoncentralRelativeAdapter adapter() const {
    return {bearings0, bearings2, cameras0, cameras2, offsets, rotations};
  }
};

Rigid3 from_opengv(const opengv::transformation_t& rig0_from_rig2) {
  const Eigen::Matrix3d rotation = rig0_from_rig2.leftCols<3>();
  return Rigid3{Eigen::Quaterniond(rotation).normalized(), rig0_from_rig2.col(3)}.inverse();
}

// Two views only: RANSAC and the non-linear optimisation of its inliers. View 1 is given the truth.
Tally run_opengv(const std::vector<Scene>& scenes, NoncentralRelativePoseSacProblem::algorithm_t algorithm,
                 double noise_px) {
  Tally tally;
  for (const Scene& scene : scenes) {
    const OpengvRays rays(rays_of(scene, 0), rays_of(scene, 2));
    auto adapter = rays.adapter();
    const double begin = processor_us();
    auto problem = std::make_shared<NoncentralRelativePoseSacProblem>(adapter, algorithm, false, false);
    opengv::sac::Ransac<NoncentralRelativePoseSacProblem> ransac;
    ransac.sac_model_ = problem;
    ransac.threshold_ = 2 * (1 - std::cos(max_error(noise_px) / kFocal));
    ransac.max_iterations_ = 1000;
    Rigid3 rig2_from_rig0;
    const bool ok = ransac.computeModel() && ransac.inliers_.size() >= 25;
    if (ok) {
      opengv::transformation_t refined;
      problem->optimizeModelCoefficients(ransac.inliers_, ransac.model_coefficients_, refined);
      rig2_from_rig0 = from_opengv(refined);
    }
    const double us = processor_us() - begin;
    const MotionError error = motion_error(scene, scene.rig1_from_rig0, rig2_from_rig0);
    tally.add(us, error, noise_px, ok, false);
  }
  return tally;
}
#endif

void print(const char* name, const Tally& tally) {
  std::printf("  %-22s %7.1f %7.1f %9.3f %9.1f %10.2f %10.2f\n", name, 100.0 * tally.right / tally.count,
              100.0 * tally.scale_known / tally.count, quantile(tally.rotations, 0.5),
              100 * quantile(tally.scales, 0.5), 1e-3 * quantile(tally.times_us, 0.5),
              1e-3 * quantile(tally.times_us, 0.95));
}

std::vector<Scene> make_scenes(const Settings& settings, int trials, uint64_t seed) {
  std::vector<Scene> scenes;
  for (int trial = 0; trial < trials; ++trial) {
    Rng rng(seed + trial, 1 + static_cast<int>(settings.kind) * 16 + static_cast<int>(settings.motion));
    scenes.push_back(make_scene(settings, rng));
  }
  return scenes;
}

void benchmark_starts(int trials, uint64_t seed) {
  std::printf("starts from 300 points, 0.5 px of noise at f = 500, 30 %% wrong\n");
  std::printf("%-24s %7s %7s %9s %9s %10s %10s\n", "", "right %", "scale %", "rot deg", "scale err",
              "median ms", "95 % ms");
  for (const Kind kind : {Kind::kStereo, Kind::kStereoCross, Kind::kRing3, Kind::kRing4, Kind::kMirror}) {
    for (const Motion motion :
         {Motion::kForward, Motion::kSideways, Motion::kRotation, Motion::kPureTranslation}) {
      for (const double share : {0.0, 0.8}) {
        if (share > 0 && kind != Kind::kStereo && kind != Kind::kRing4) continue;
        const auto scenes = make_scenes({kind, motion, 300, 0.5, 0.3, share}, trials, seed);
        std::printf("%s, %s%s\n", name_of(kind), name_of(motion), share > 0 ? ", 80 % in camera 0" : "");
        print("raysfm", run_ours(scenes, GenericStartMethod::kAuto, 0.5));
        if (share > 0) continue;
        const int few = std::max(1, trials / 5);
        const std::vector<Scene> fewer(scenes.begin(), scenes.begin() + few);
        print("raysfm 17 points", run_ours(fewer, GenericStartMethod::kSeventeenPoint, 0.5));
#ifdef RAYSFM_HAVE_OPENGV
        print("OpenGV 17 points", run_opengv(fewer, NoncentralRelativePoseSacProblem::SEVENTEENPT, 0.5));
        // Seconds each.
        const std::vector<Scene> fewest(scenes.begin(), scenes.begin() + std::max(1, trials / 25));
        print("OpenGV six points", run_opengv(fewest, NoncentralRelativePoseSacProblem::SIXPT, 0.5));
        print("OpenGV eigenvalues", run_opengv(fewer, NoncentralRelativePoseSacProblem::GE, 0.5));
#endif
      }
    }
  }
}

void benchmark_noise(int trials, uint64_t seed) {
  std::printf("\nright %% of raysfm's starts over noise and outliers, even among the cameras\n");
  std::printf("%-24s", "noise px / wrong %");
  for (const char* text : {"0/0", "0/40", "0.5/0", "0.5/40", "1/0", "1/40", "2/0", "2/40"}) {
    std::printf(" %7s", text);
  }
  std::printf("\n");
  for (const Kind kind : {Kind::kCentral, Kind::kStereo, Kind::kStereoCross, Kind::kRing3, Kind::kMirror}) {
    for (const Motion motion : {Motion::kForward, Motion::kRotation, Motion::kPureTranslation}) {
      std::printf("%-10s %-13s", name_of(kind), name_of(motion));
      for (const double noise : {0.0, 0.5, 1.0, 2.0}) {
        for (const double outliers : {0.0, 0.4}) {
          const auto scenes = make_scenes({kind, motion, 300, noise, outliers, 0}, trials, seed);
          const Tally tally = run_ours(scenes, GenericStartMethod::kAuto, noise);
          std::printf(" %7.1f", 100.0 * tally.right / tally.count);
        }
      }
      std::printf("\n");
    }
  }
}

// One solver called on a minimal sample: how often the truth is among its solutions and the median error of
// the best one with noise.
struct Minimal {
  std::string name;
  int points;
  std::function<std::vector<Rigid3>(const std::vector<Ray>&, const std::vector<Ray>&, const Scene&)> solve;
};

double rotation_error(const std::vector<Rigid3>& poses, const Scene& scene) {
  double best = M_PI;
  for (const Rigid3& pose : poses) {
    best = std::min(best, rotation_angle(pose.rotation * scene.rig2_from_rig0.rotation.conjugate()));
  }
  return best;
}

std::vector<Minimal> relative_solvers() {
  std::vector<Minimal> solvers;
  solvers.push_back({"raysfm 17 points", 17,
                     [](const std::vector<Ray>& rays0, const std::vector<Ray>& rays2, const Scene&) {
                       std::array<Rigid3, 4> poses;
                       const int count = seventeen_point(rays0, rays2, classify_rays(rays0, rays2), &poses);
                       return std::vector<Rigid3>(poses.begin(), poses.begin() + count);
                     }});
#ifdef RAYSFM_HAVE_OPENGV
  solvers.push_back({"OpenGV 17 points", 17,
                     [](const std::vector<Ray>& rays0, const std::vector<Ray>& rays2, const Scene&) {
                       const OpengvRays rays(rays0, rays2);
                       auto adapter = rays.adapter();
                       return std::vector<Rigid3>{from_opengv(opengv::relative_pose::seventeenpt(adapter))};
                     }});
  const auto rotations_only = [](const opengv::rotation_t& rig0_from_rig2) {
    return Rigid3{Eigen::Quaterniond(rig0_from_rig2).conjugate().normalized(), Vector3d::Zero()};
  };
  solvers.push_back({"OpenGV six points", 6,
                     [=](const std::vector<Ray>& rays0, const std::vector<Ray>& rays2, const Scene&) {
                       const OpengvRays rays(rays0, rays2);
                       auto adapter = rays.adapter();
                       std::vector<Rigid3> poses;
                       for (const auto& r : opengv::relative_pose::sixpt(adapter)) {
                         poses.push_back(rotations_only(r));
                       }
                       return poses;
                     }});
  solvers.push_back({"OpenGV eigenvalues", 8,
                     [=](const std::vector<Ray>& rays0, const std::vector<Ray>& rays2, const Scene&) {
                       const OpengvRays rays(rays0, rays2);
                       auto adapter = rays.adapter();
                       return std::vector<Rigid3>{rotations_only(opengv::relative_pose::ge(adapter))};
                     }});
#endif
  return solvers;
}

void benchmark_relative_solvers(int trials, uint64_t seed) {
  std::printf("\nrelative pose of two views from a sample: rotation of the best solution\n");
  std::printf("%-12s %-20s %16s %18s %10s\n", "", "", "exact: < 1e-4 %", "0.5 px: median deg", "median us");
  std::vector<Minimal> solvers = relative_solvers();
  for (const Kind kind : {Kind::kStereo, Kind::kRing3, Kind::kRing4, Kind::kMirror}) {
    std::vector<int> found(solvers.size(), 0);
    std::vector<std::vector<double>> errors(solvers.size()), times(solvers.size());
    for (const double noise : {0.0, 0.5}) {
      for (const Scene& scene : make_scenes({kind, Motion::kRotation, 17, noise, 0, 0}, trials, seed)) {
        const std::vector<Ray> all0 = rays_of(scene, 0), all2 = rays_of(scene, 2);
        for (size_t s = 0; s < solvers.size(); ++s) {
          const std::vector<Ray> rays0(all0.begin(), all0.begin() + solvers[s].points),
              rays2(all2.begin(), all2.begin() + solvers[s].points);
          const double begin = processor_us();
          const std::vector<Rigid3> poses = solvers[s].solve(rays0, rays2, scene);
          times[s].push_back(processor_us() - begin);
          const double error = rotation_error(poses, scene);
          if (noise > 0)
            errors[s].push_back(error / kDegree);
          else
            found[s] += error < 1e-4;
        }
      }
    }
    for (size_t s = 0; s < solvers.size(); ++s) {
      std::printf("%-12s %-20s %16.1f %18.2f %10.1f\n", name_of(kind), solvers[s].name.c_str(),
                  100.0 * found[s] / trials, quantile(errors[s], 0.5), quantile(times[s], 0.5));
    }
  }
}

// Three exact rays: truth among the solutions, time per call over many calls.
void benchmark_p3p(int trials, uint64_t seed) {
  constexpr int kCalls = 200;
  std::printf("\ngeneralised P3P: three exact rays\n%-12s %-20s %10s %14s %10s\n", "", "", "solutions",
              "truth found %", "us");
  for (const Kind kind : {Kind::kRing3, Kind::kMirror}) {
    const auto scenes =
        make_scenes({kind, Motion::kRotation, 3 * kCalls, 0, 0, 0}, std::max(1, trials / 10), seed);
    double solutions[2] = {}, found[2] = {}, time[2] = {};
    for (const Scene& scene : scenes) {
      const std::vector<Ray> all = rays_of(scene, 2);
      const auto judge = [&](int who, const Rigid3* poses, int count) {
        double best = 1;
        for (int k = 0; k < count; ++k) {
          best =
              std::min(best, rotation_angle(poses[k].rotation * scene.rig2_from_rig0.rotation.conjugate()));
        }
        solutions[who] += count, found[who] += best < 1e-6;
      };
      std::vector<std::array<Rigid3, 8>> poses(kCalls);
      std::vector<int> counts(kCalls);
      double begin = processor_us();
      for (int i = 0; i < kCalls; ++i) {
        counts[i] = generalised_p3p(std::span<const Ray, 3>(&all[3 * i], 3),
                                    std::span<const Vector3d, 3>(&scene.points_in_rig0[3 * i], 3), &poses[i]);
      }
      time[0] += processor_us() - begin;
      for (int i = 0; i < kCalls; ++i) judge(0, poses[i].data(), counts[i]);
#ifdef RAYSFM_HAVE_OPENGV
      opengv::bearingVectors_t bearings;
      opengv::points_t points(scene.points_in_rig0.begin(), scene.points_in_rig0.end());
      opengv::translations_t offsets;
      std::vector<int> cameras;
      for (const Ray& ray : all) {
        cameras.push_back(static_cast<int>(offsets.size()));
        bearings.push_back(ray.direction), offsets.push_back(ray.origin);
      }
      const opengv::rotations_t rotations(offsets.size(), opengv::rotation_t::Identity());
      opengv::absolute_pose::NoncentralAbsoluteAdapter adapter(bearings, cameras, points, offsets, rotations);
      std::vector<opengv::transformations_t> results(kCalls);
      begin = processor_us();
      for (int i = 0; i < kCalls; ++i) {
        results[i] = opengv::absolute_pose::gp3p(adapter, std::vector<int>{3 * i, 3 * i + 1, 3 * i + 2});
      }
      time[1] += processor_us() - begin;
      for (const auto& transformations : results) {
        std::vector<Rigid3> found_poses;
        for (const auto& t : transformations) found_poses.push_back(from_opengv(t));
        judge(1, found_poses.data(), static_cast<int>(found_poses.size()));
      }
#endif
    }
    const double calls = kCalls * static_cast<double>(scenes.size());
    for (int who = 0; who < 2; ++who) {
      if (time[who] <= 0) continue;
      std::printf("%-12s %-20s %10.2f %14.2f %10.2f\n", name_of(kind), who == 0 ? "raysfm" : "OpenGV gp3p",
                  solutions[who] / calls, 100 * found[who] / calls, time[who] / calls);
    }
  }
}

// Pose of view 2 from 300 points known in view 0's frame, the prior off by 3 degrees and 0.2 units.
void benchmark_pose(int trials, uint64_t seed) {
  std::printf("\npose from 300 rays, 0.5 px: within 0.2 degrees\n%-12s %-10s %-22s %8s %10s %10s\n", "",
              "wrong %", "", "right %", "median ms", "95 % ms");
  for (const Kind kind : {Kind::kRing4, Kind::kMirror}) {
    for (const double outliers : {0.1, 0.3, 0.5}) {
      const auto scenes = make_scenes({kind, Motion::kRotation, 300, 0.5, outliers, 0}, trials, seed);
      for (const bool five : {false, true}) {
        int right = 0;
        std::vector<double> times;
        PoseEstimator estimator;
        PoseEstimate estimate;
        for (const Scene& scene : scenes) {
          std::vector<ObservedRay> rays;
          for (size_t i = 0; i < scene.rays.size(); ++i) {
            if (scene.views[i] == 2) rays.push_back(scene.rays[i]);
          }
          Rng rng(seed, 5);
          const Rigid3& truth = scene.rig2_from_rig0;
          const Rigid3 prior{exp_so3(0.05 * normal_vector(rng).normalized()) * truth.rotation,
                             truth.translation + 0.2 * normal_vector(rng).normalized()};
          PoseOptions options;
          options.method = five ? PoseMethod::kFiveRays : PoseMethod::kThreeRays;
          options.max_error_px = 1.5;
          const double begin = processor_us();
          estimator.estimate({}, {scene.points_in_rig0, {}, {}, rays}, five ? &prior : nullptr, options,
                             &estimate);
          times.push_back(processor_us() - begin);
          const Eigen::Quaterniond off = estimate.rig_from_world.rotation * truth.rotation.conjugate();
          right += estimate.ok() && rotation_angle(off) < 0.2 * kDegree;
        }
        std::printf("%-12s %-10.0f %-22s %8.1f %10.2f %10.2f\n", name_of(kind), 100 * outliers,
                    five ? "five rays (LBA09 4.5)" : "three rays", 100.0 * right / trials,
                    1e-3 * quantile(times, 0.5), 1e-3 * quantile(times, 0.95));
      }
    }
  }
}

}  // namespace

int main(int argc, char** argv) {
  const int trials = argc > 1 ? std::max(1, std::atoi(argv[1])) : 100;
  const uint64_t seed = argc > 2 ? std::strtoull(argv[2], nullptr, 10) : 1;
  benchmark_starts(trials, seed);
  benchmark_noise(std::max(1, trials / 2), seed);
  benchmark_relative_solvers(trials, seed);
  benchmark_p3p(trials, seed);
  benchmark_pose(trials, seed);
}
