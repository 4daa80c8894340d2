#pragma once

#include <ceres/ceres.h>

#include <cmath>

#include "support/bundle_scene.h"

namespace raysfm::test {

// Pinhole reprojection with analytic derivatives for Ceres, written from the projection equation alone: pose
// as quaternion x, y, z, w and translation, updated on the left. Cameras other than a pinhole at the origin
// of the rig are not for it.
class CeresReprojection : public ceres::SizedCostFunction<2, 4, 3, 3> {
 public:
  CeresReprojection(const Pinhole& camera, const Eigen::Vector2d& pixel) : camera_(camera), pixel_(pixel) {}

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const Eigen::Map<const Eigen::Quaterniond> q(parameters[0]);
    const Eigen::Map<const Eigen::Vector3d> t(parameters[1]), point(parameters[2]);
    const Eigen::Matrix3d r = q.toRotationMatrix();
    const Eigen::Vector3d rotated = r * point, x = rotated + t;
    const double inverse = 1.0 / x.z();
    residuals[0] = camera_.fx * x.x() * inverse + camera_.cx - pixel_.x();
    residuals[1] = camera_.fy * x.y() * inverse + camera_.cy - pixel_.y();
    if (!jacobians) return true;
    Eigen::Matrix<double, 2, 3, Eigen::RowMajor> j;
    j << camera_.fx * inverse, 0, -camera_.fx * x.x() * inverse * inverse, 0, camera_.fy * inverse,
        -camera_.fy * x.y() * inverse * inverse;
    if (jacobians[0]) {
      // Columns 0 to 2 hold the derivative by the tangent; LeftQuaternion's plus Jacobian selects them.
      Eigen::Map<Eigen::Matrix<double, 2, 4, Eigen::RowMajor>> out(jacobians[0]);
      Eigen::Matrix3d minus_skew;
      minus_skew << 0, rotated.z(), -rotated.y(), -rotated.z(), 0, rotated.x(), rotated.y(), -rotated.x(), 0;
      out.leftCols<3>() = j * minus_skew;
      out.col(3).setZero();
    }
    using Map23 = Eigen::Map<Eigen::Matrix<double, 2, 3, Eigen::RowMajor>>;
    if (jacobians[1]) Map23{jacobians[1]} = j;
    if (jacobians[2]) Map23{jacobians[2]} = j * r;
    return true;
  }

 private:
  Pinhole camera_;
  Eigen::Vector2d pixel_;
};

class LeftQuaternion : public ceres::Manifold {
 public:
  int AmbientSize() const override { return 4; }
  int TangentSize() const override { return 3; }
  bool Plus(const double* x, const double* delta, double* result) const override {
    const Eigen::Map<const Eigen::Vector3d> w(delta);
    const double angle = w.norm();
    const Eigen::Quaterniond step =
        angle > 0 ? Eigen::Quaterniond(Eigen::AngleAxisd(angle, w / angle)) : Eigen::Quaterniond::Identity();
    Eigen::Map<Eigen::Quaterniond> out(result);
    out = (step * Eigen::Map<const Eigen::Quaterniond>(x)).normalized();
    return true;
  }
  bool PlusJacobian(const double*, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, 4, 3, Eigen::RowMajor>> out(jacobian);
    out.setZero();
    out.topRows<3>().setIdentity();
    return true;
  }
  bool Minus(const double*, const double*, double*) const override { return false; }
  bool MinusJacobian(const double*, double*) const override { return false; }
};

struct CeresBundleOptions {
  RobustLoss loss = {};
  int max_iterations = 10;
  double function_tolerance = 1e-6;
  ceres::LinearSolverType solver = ceres::DENSE_SCHUR;
  int threads = 1;
  double max_seconds = 1e9;
};

inline ceres::LossFunction* ceres_loss(const RobustLoss& loss) {
  switch (loss.kind) {
    case RobustLoss::Kind::kHuber:
      return new ceres::HuberLoss(loss.scale);
    case RobustLoss::Kind::kCauchy:
      return new ceres::CauchyLoss(loss.scale);
    case RobustLoss::Kind::kTukey:
      return new ceres::TukeyLoss(loss.scale);
    case RobustLoss::Kind::kNone:
      break;
  }
  return nullptr;
}

inline ceres::Solver::Summary solve_with_ceres(ceres::Problem* problem,
                                               ceres::ParameterBlockOrdering* ordering,
                                               const CeresBundleOptions& options) {
  ceres::Solver::Options solver;
  solver.linear_solver_type = options.solver;
  solver.linear_solver_ordering.reset(ordering);
  solver.max_num_iterations = options.max_iterations;
  solver.function_tolerance = options.function_tolerance;
  solver.gradient_tolerance = 0;
  solver.parameter_tolerance = 0;
  solver.num_threads = options.threads;
  solver.max_solver_time_in_seconds = options.max_seconds;
  solver.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver, problem, &summary);
  return summary;
}

// Adjusts the scene's poses and points with Ceres. The cameras must be pinholes at the rig's
// origin.
inline ceres::Solver::Summary adjust_with_ceres(BundleScene& scene, const CeresBundleOptions& options) {
  ceres::Problem problem;
  for (size_t i = 0; i < scene.observations.size(); ++i) {
    const BundleObservation& o = scene.observations[i];
    if (!scene.is_inlier[i]) continue;
    Rigid3& pose = scene.poses[o.pose];
    problem.AddResidualBlock(new CeresReprojection(std::get<Pinhole>(scene.cameras[o.camera].model), o.pixel),
                             ceres_loss(options.loss), pose.rotation.coeffs().data(), pose.translation.data(),
                             scene.points[o.point].data());
  }
  auto* ordering = new ceres::ParameterBlockOrdering;
  for (size_t p = 0; p < scene.points.size(); ++p) {
    if (problem.HasParameterBlock(scene.points[p].data()))
      ordering->AddElementToGroup(scene.points[p].data(), 0);
  }
  for (size_t i = 0; i < scene.poses.size(); ++i) {
    double* q = scene.poses[i].rotation.coeffs().data();
    double* t = scene.poses[i].translation.data();
    if (!problem.HasParameterBlock(q)) continue;
    problem.SetManifold(q, new LeftQuaternion);
    ordering->AddElementToGroup(q, 1);
    ordering->AddElementToGroup(t, 1);
    if (scene.pose_is_free[i]) continue;
    problem.SetParameterBlockConstant(q);
    problem.SetParameterBlockConstant(t);
  }
  return solve_with_ceres(&problem, ordering, options);
}

// The projection of Bundle Adjustment in the Large with analytic derivatives, written from its formulas; the
// derivative by the rotation vector w is that of exp(w + d) = exp(J_l(w) d) exp(w).
class CeresBalReprojection : public ceres::SizedCostFunction<2, 9, 3> {
 public:
  explicit CeresBalReprojection(const Eigen::Vector2d& pixel) : pixel_(pixel) {}

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const double* c = parameters[0];
    const Eigen::Map<const Eigen::Vector3d> w(c), t(c + 3), point(parameters[1]);
    const double angle = w.norm();
    const Eigen::Matrix3d r = angle > 0 ? Eigen::AngleAxisd(angle, w / angle).toRotationMatrix()
                                        : Eigen::Matrix3d(Eigen::Matrix3d::Identity());
    const Eigen::Vector3d rotated = r * point, x = rotated + t;
    const Eigen::Vector2d p = -x.head<2>() / x.z();
    const double s = p.squaredNorm(), g = 1 + c[7] * s + c[8] * s * s;
    Eigen::Map<Eigen::Vector2d>{residuals} = c[6] * g * p - pixel_;
    if (!jacobians) return true;
    const Eigen::Matrix2d by_p =
        c[6] * (g * Eigen::Matrix2d::Identity() + (2 * c[7] + 4 * c[8] * s) * p * p.transpose());
    Eigen::Matrix<double, 2, 3> p_by_x;
    p_by_x << -1, 0, -p.x(), 0, -1, -p.y();
    const Eigen::Matrix<double, 2, 3> a = by_p * p_by_x / x.z();
    if (jacobians[0]) {
      const Eigen::Matrix3d k = skew(w);
      const double a2 = angle * angle;
      const Eigen::Matrix3d left =
          angle > 1e-8 ? Eigen::Matrix3d(Eigen::Matrix3d::Identity() + (1 - std::cos(angle)) / a2 * k +
                                         (angle - std::sin(angle)) / (a2 * angle) * k * k)
                       : Eigen::Matrix3d(Eigen::Matrix3d::Identity());
      Eigen::Map<Eigen::Matrix<double, 2, 9, Eigen::RowMajor>> out(jacobians[0]);
      out.leftCols<3>() = -a * skew(rotated) * left;
      out.middleCols<3>(3) = a;
      out.col(6) = g * p;
      out.col(7) = c[6] * s * p;
      out.col(8) = c[6] * s * s * p;
    }
    if (jacobians[1]) Eigen::Map<Eigen::Matrix<double, 2, 3, Eigen::RowMajor>>{jacobians[1]} = a * r;
    return true;
  }

 private:
  Eigen::Vector2d pixel_;
};

inline ceres::Solver::Summary adjust_with_ceres(BalProblem& bal, const CeresBundleOptions& options) {
  ceres::Problem problem;
  auto* ordering = new ceres::ParameterBlockOrdering;
  for (const BalProblem::Observation& o : bal.observations) {
    problem.AddResidualBlock(new CeresBalReprojection(o.pixel), ceres_loss(options.loss),
                             bal.cameras[o.camera].data(), bal.points[o.point].data());
    ordering->AddElementToGroup(bal.points[o.point].data(), 0);
    ordering->AddElementToGroup(bal.cameras[o.camera].data(), 1);
  }
  return solve_with_ceres(&problem, ordering, options);
}

}  // namespace raysfm::test
