// Minimal solvers beside OpenGV's on the same problems. Prints, for each solver and scene: solutions per
// problem, the part of them that satisfy the equations, how often the truth is among them (noise-free),
// the median error of the best one with one pixel of noise (f = 1000), and the median time per problem.
// Usage: solvers_benchmark [problems, default 10000] [seed, default 1]

#include <Eigen/Dense>
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "raysfm/core/random.h"
#include "raysfm/core/timer.h"
#include "raysfm/solvers/five_point.h"
#include "raysfm/solvers/p3p.h"

#ifdef RAYSFM_HAVE_OPENGV
#include <opengv/absolute_pose/CentralAbsoluteAdapter.hpp>
#include <opengv/absolute_pose/methods.hpp>
#include <opengv/relative_pose/CentralRelativeAdapter.hpp>
#include <opengv/relative_pose/methods.hpp>
#endif

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using raysfm::Rigid3;
using raysfm::Rng;

constexpr double kNoise = 1e-3;  // radians per axis: one pixel at f = 1000
constexpr double kFound = 1e-6;

struct Scene {
  std::string name;
  bool planar, forward;
};

// n matched bearings of two views and the points; in absolute problems view 0 is the world.
template <int N>
struct Problem {
  std::array<Vector3d, N> points, bearings0, bearings1;
  Rigid3 cam1_from_cam0;
};

Vector3d normal_vector(Rng& rng) {
  return {rng.normal(), rng.normal(), rng.normal()};
}

template <int N>
std::vector<Problem<N>> make_problems(const Scene& scene, double noise, int count, Rng rng) {
  std::vector<Problem<N>> problems(count);
  for (Problem<N>& problem : problems) {
    const Vector3d t =
        scene.forward ? Vector3d(0.05 * rng.normal(), 0.05 * rng.normal(), -1) : normal_vector(rng);
    problem.cam1_from_cam0 = {raysfm::exp_so3(0.2 * normal_vector(rng)), t.normalized()};
    const Vector3d plane = Vector3d(0.3 * rng.normal(), 0.3 * rng.normal(), 1).normalized();
    for (int i = 0; i < N; ++i) {
      Vector3d x(rng.uniform(-0.8, 0.8), rng.uniform(-0.8, 0.8), 1);
      x *= scene.planar ? 4 / plane.dot(x) : rng.uniform(3, 10);
      problem.points[i] = x;
      problem.bearings0[i] = (x.normalized() + noise * normal_vector(rng)).normalized();
      problem.bearings1[i] =
          ((problem.cam1_from_cam0 * x).normalized() + noise * normal_vector(rng)).normalized();
    }
  }
  return problems;
}

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

// One solver: solves problem i, leaving its solutions in a buffer that `solutions` reads.
template <typename Solution>
struct Solver {
  std::string name;
  std::function<int(int)> solve;                     // number of solutions of problem i
  std::function<std::vector<Solution>()> solutions;  // of the last problem
};

// Median over repetitions of the mean time of a problem, microseconds; the solvers take turns.
template <typename Solution>
std::vector<double> measure(std::vector<Solver<Solution>>& solvers, int problems) {
  constexpr int kRepetitions = 15;
  const int count = std::min(problems, 2000);
  std::vector<std::vector<double>> times(solvers.size());
  volatile int sink = 0;
  for (int repetition = 0; repetition < kRepetitions; ++repetition) {
    for (size_t s = 0; s < solvers.size(); ++s) {
      const auto start = raysfm::Clock::now();
      for (int i = 0; i < count; ++i) sink = sink + solvers[s].solve(i);
      times[s].push_back(1e3 * raysfm::milliseconds_since(start) / count);
    }
  }
  std::vector<double> medians;
  for (const auto& t : times) medians.push_back(median(t));
  return medians;
}

struct Quality {
  double solutions = 0, valid = 0, found = 0, median_error = 0;
};

// error(i, solution) against the truth of problem i, valid(i, solution) whether it satisfies the equations.
template <typename Solution, typename Error, typename Valid>
Quality judge(Solver<Solution>& solver, int problems, const Error& error, const Valid& valid) {
  Quality quality;
  std::vector<double> errors;
  for (int i = 0; i < problems; ++i) {
    solver.solve(i);
    double best = std::numeric_limits<double>::infinity();
    for (const Solution& solution : solver.solutions()) {
      const double e = error(i, solution);
      if (e < best) best = e;
      quality.solutions += 1;
      quality.valid += valid(i, solution);
    }
    quality.found += best < kFound;
    errors.push_back(best);
  }
  quality.valid /= std::max(1.0, quality.solutions);
  quality.solutions /= problems;
  quality.found /= problems;
  quality.median_error = median(errors);
  return quality;
}

void print_header(const char* title, const char* unit) {
  std::printf("\n%-12s %-22s %9s %9s %12s %18s %10s\n", title, "solver", "solutions", "valid %",
              "truth found %", unit, "time us");
}

void print_row(const std::string& scene, const std::string& solver, const Quality& exact,
               const Quality& noisy, double time) {
  std::printf("%-12s %-22s %9.2f %9.3f %12.3f %18.3g %10.2f\n", scene.c_str(), solver.c_str(),
              exact.solutions, 100 * exact.valid, 100 * exact.found, noisy.median_error, time);
}

// --- five points
// ---------------------------------------------------------------------------------------------

using FivePointProblems = std::vector<Problem<5>>;

Solver<Matrix3d> our_five_point(const FivePointProblems& problems) {
  struct State {
    std::array<Matrix3d, 10> essentials;
    int count = 0;
  };
  auto state = std::make_shared<State>();
  return {"raysfm five_point",
          [&problems, state](int i) {
            return state->count =
                       raysfm::five_point(problems[i].bearings0, problems[i].bearings1, &state->essentials);
          },
          [state] {
            return std::vector<Matrix3d>(state->essentials.begin(), state->essentials.begin() + state->count);
          }};
}

#ifdef RAYSFM_HAVE_OPENGV
struct RelativeInput {
  opengv::bearingVectors_t bearings0, bearings1;
  std::unique_ptr<opengv::relative_pose::CentralRelativeAdapter> adapter;
};

std::shared_ptr<std::vector<RelativeInput>> relative_inputs(const FivePointProblems& problems) {
  auto inputs = std::make_shared<std::vector<RelativeInput>>(problems.size());
  for (size_t i = 0; i < problems.size(); ++i) {
    RelativeInput& input = (*inputs)[i];
    // OpenGV's essential matrix satisfies f1^T E f2 = 0: the views change places.
    input.bearings0.assign(problems[i].bearings0.begin(), problems[i].bearings0.end());
    input.bearings1.assign(problems[i].bearings1.begin(), problems[i].bearings1.end());
    input.adapter =
        std::make_unique<opengv::relative_pose::CentralRelativeAdapter>(input.bearings1, input.bearings0);
  }
  return inputs;
}

// Of either convention of f1, f2: the one that fits the matches.
Matrix3d oriented(const Matrix3d& e, const opengv::bearingVectors_t& b0, const opengv::bearingVectors_t& b1) {
  double direct = 0, transposed = 0;
  for (size_t i = 0; i < b0.size(); ++i) {
    direct += std::abs(b1[i].dot(e * b0[i]));
    transposed += std::abs(b0[i].dot(e * b1[i]));
  }
  const Matrix3d chosen = direct <= transposed ? e : Matrix3d(e.transpose());
  return chosen * (std::sqrt(2.0) / chosen.norm());
}

Solver<Matrix3d> opengv_stewenius(const FivePointProblems& problems) {
  auto inputs = relative_inputs(problems);
  struct State {
    opengv::complexEssentials_t essentials;
    int problem = 0;
  };
  auto state = std::make_shared<State>();
  return {"OpenGV fivept_stewenius",
          [inputs, state](int i) {
            state->problem = i;
            state->essentials = opengv::relative_pose::fivept_stewenius(*(*inputs)[i].adapter);
            return static_cast<int>(state->essentials.size());
          },
          [inputs, state] {
            std::vector<Matrix3d> real;
            for (const auto& e : state->essentials) {
              const RelativeInput& input = (*inputs)[state->problem];
              if (e.imag().norm() < 1e-2 * e.norm())
                real.push_back(oriented(e.real(), input.bearings0, input.bearings1));
            }
            return real;
          }};
}

Solver<Matrix3d> opengv_nister(const FivePointProblems& problems) {
  auto inputs = relative_inputs(problems);
  struct State {
    opengv::essentials_t essentials;
    int problem = 0;
  };
  auto state = std::make_shared<State>();
  return {"OpenGV fivept_nister",
          [inputs, state](int i) {
            state->problem = i;
            state->essentials = opengv::relative_pose::fivept_nister(*(*inputs)[i].adapter);
            return static_cast<int>(state->essentials.size());
          },
          [inputs, state] {
            std::vector<Matrix3d> real;
            for (const auto& e : state->essentials) {
              const RelativeInput& input = (*inputs)[state->problem];
              real.push_back(oriented(e, input.bearings0, input.bearings1));
            }
            return real;
          }};
}
#endif

std::vector<Solver<Matrix3d>> five_point_solvers(const FivePointProblems& problems) {
  std::vector<Solver<Matrix3d>> solvers = {our_five_point(problems)};
#ifdef RAYSFM_HAVE_OPENGV
  solvers.push_back(opengv_stewenius(problems));
  solvers.push_back(opengv_nister(problems));
#endif
  return solvers;
}

Quality judge_five_point(Solver<Matrix3d>& solver, const FivePointProblems& problems) {
  const auto error = [&](int i, const Matrix3d& e) {
    const Rigid3& truth = problems[i].cam1_from_cam0;
    const Matrix3d expected = raysfm::skew(truth.translation) * truth.rotation.toRotationMatrix();
    return std::min((e - expected).norm(), (e + expected).norm()) / std::sqrt(2.0);
  };
  const auto valid = [&](int i, const Matrix3d& e) {
    const Vector3d values = e.jacobiSvd().singularValues();
    bool good = (values - Vector3d(1, 1, 0)).norm() < kFound;
    for (int j = 0; j < 5; ++j) {
      good &= std::abs(problems[i].bearings1[j].dot(e * problems[i].bearings0[j])) < kFound;
    }
    return good;
  };
  return judge(solver, static_cast<int>(problems.size()), error, valid);
}

void benchmark_five_point(int count, uint64_t seed) {
  print_header("five points", "noisy median |dE|");
  for (const Scene& scene : {Scene{"general", false, false}, Scene{"planar", true, false},
                             Scene{"forward", false, true}, Scene{"both", true, true}}) {
    const FivePointProblems exact = make_problems<5>(scene, 0, count, Rng(seed, 1));
    const FivePointProblems noisy = make_problems<5>(scene, kNoise, count, Rng(seed, 2));
    auto on_exact = five_point_solvers(exact), on_noisy = five_point_solvers(noisy);
    const std::vector<double> times = measure(on_noisy, count);
    for (size_t s = 0; s < on_exact.size(); ++s) {
      print_row(scene.name, on_exact[s].name, judge_five_point(on_exact[s], exact),
                judge_five_point(on_noisy[s], noisy), times[s]);
    }
  }
}

// --- three points
// --------------------------------------------------------------------------------------------

using P3pProblems = std::vector<Problem<3>>;

Solver<Rigid3> our_p3p(const P3pProblems& problems) {
  struct State {
    std::array<Rigid3, 4> poses;
    int count = 0;
  };
  auto state = std::make_shared<State>();
  return {"raysfm p3p",
          [&problems, state](int i) {
            return state->count = raysfm::p3p(problems[i].bearings1, problems[i].points, &state->poses);
          },
          [state] { return std::vector<Rigid3>(state->poses.begin(), state->poses.begin() + state->count); }};
}

#ifdef RAYSFM_HAVE_OPENGV
Solver<Rigid3> opengv_p3p(const P3pProblems& problems, bool kneip) {
  struct Input {
    opengv::bearingVectors_t bearings;
    opengv::points_t points;
    std::unique_ptr<opengv::absolute_pose::CentralAbsoluteAdapter> adapter;
  };
  auto inputs = std::make_shared<std::vector<Input>>(problems.size());
  for (size_t i = 0; i < problems.size(); ++i) {
    Input& input = (*inputs)[i];
    input.bearings.assign(problems[i].bearings1.begin(), problems[i].bearings1.end());
    input.points.assign(problems[i].points.begin(), problems[i].points.end());
    input.adapter =
        std::make_unique<opengv::absolute_pose::CentralAbsoluteAdapter>(input.bearings, input.points);
  }
  auto state = std::make_shared<opengv::transformations_t>();
  return {kneip ? "OpenGV p3p_kneip" : "OpenGV p3p_gao",
          [inputs, state, kneip](int i) {
            const auto& adapter = *(*inputs)[i].adapter;
            *state =
                kneip ? opengv::absolute_pose::p3p_kneip(adapter) : opengv::absolute_pose::p3p_gao(adapter);
            return static_cast<int>(state->size());
          },
          [state] {
            std::vector<Rigid3> poses;
            for (const auto& world_from_cam : *state) {
              poses.push_back(
                  Rigid3{Eigen::Quaterniond(Matrix3d(world_from_cam.leftCols<3>())), world_from_cam.col(3)}
                      .inverse());
            }
            return poses;
          }};
}
#endif

std::vector<Solver<Rigid3>> p3p_solvers(const P3pProblems& problems) {
  std::vector<Solver<Rigid3>> solvers = {our_p3p(problems)};
#ifdef RAYSFM_HAVE_OPENGV
  solvers.push_back(opengv_p3p(problems, true));
  solvers.push_back(opengv_p3p(problems, false));
#endif
  return solvers;
}

Quality judge_p3p(Solver<Rigid3>& solver, const P3pProblems& problems) {
  const auto error = [&](int i, const Rigid3& pose) {
    const Rigid3& truth = problems[i].cam1_from_cam0;
    return std::max((pose.rotation.toRotationMatrix() - truth.rotation.toRotationMatrix()).norm(),
                    (pose.translation - truth.translation).norm());
  };
  const auto valid = [&](int i, const Rigid3& pose) {
    bool good = std::abs(pose.rotation.norm() - 1) < kFound;
    for (int j = 0; j < 3; ++j) {
      good &= ((pose * problems[i].points[j]).normalized() - problems[i].bearings1[j]).norm() < kFound;
    }
    return good;
  };
  return judge(solver, static_cast<int>(problems.size()), error, valid);
}

void benchmark_p3p(int count, uint64_t seed) {
  print_header("three points", "noisy median error");
  for (const Scene& scene : {Scene{"general", false, false}, Scene{"planar", true, false}}) {
    const P3pProblems exact = make_problems<3>(scene, 0, count, Rng(seed, 3));
    const P3pProblems noisy = make_problems<3>(scene, kNoise, count, Rng(seed, 4));
    auto on_exact = p3p_solvers(exact), on_noisy = p3p_solvers(noisy);
    const std::vector<double> times = measure(on_noisy, count);
    for (size_t s = 0; s < on_exact.size(); ++s) {
      print_row(scene.name, on_exact[s].name, judge_p3p(on_exact[s], exact), judge_p3p(on_noisy[s], noisy),
                times[s]);
    }
  }
}

}  // namespace

int main(int argc, char** argv) {
  const int count = argc > 1 ? std::max(1, std::atoi(argv[1])) : 10000;
  const uint64_t seed = argc > 2 ? std::strtoull(argv[2], nullptr, 10) : 1;
  benchmark_five_point(count, seed);
  benchmark_p3p(count, seed);
#ifndef RAYSFM_HAVE_OPENGV
  std::printf("\nOpenGV is not installed: no rivals\n");
#endif
}
