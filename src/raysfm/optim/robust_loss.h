#pragma once

#include <cmath>

namespace raysfm {

// rho(s) of a squared residual s = |r|^2, so that an adjustment minimises 1/2 sum rho(s). Every rho is scaled
// to rho(s) ~ s near zero. `scale` is the |r| where the loss leaves the parabola: Huber's corner, Cauchy's
// width, the |r| beyond which Tukey ignores the residual; in the units of r, positive, unused by kNone.
struct RobustLoss {
  enum class Kind { kNone, kHuber, kCauchy, kTukey };
  Kind kind = Kind::kNone;
  double scale = 1.0;

  // Whether a residual draws less the larger it is: what a minimum leaves out depends on where it was sought.
  bool redescends() const { return kind == Kind::kCauchy || kind == Kind::kTukey; }

  // rho(s), s >= 0.
  double cost(double squared_residual) const {
    const double s = squared_residual, a2 = scale * scale;
    switch (kind) {
      case Kind::kHuber:
        return s <= a2 ? s : 2.0 * scale * std::sqrt(s) - a2;
      case Kind::kCauchy:
        return a2 * std::log1p(s / a2);
      case Kind::kTukey: {
        if (s >= a2) return a2 / 3.0;
        const double u = 1.0 - s / a2;
        return a2 / 3.0 * (1.0 - u * u * u);
      }
      case Kind::kNone:
        break;
    }
    return s;
  }

  // rho'(s), the weight of the residual in reweighted least squares; in [0, 1].
  double weight(double squared_residual) const {
    const double s = squared_residual, a2 = scale * scale;
    switch (kind) {
      case Kind::kHuber:
        return s <= a2 ? 1.0 : scale / std::sqrt(s);
      case Kind::kCauchy:
        return a2 / (a2 + s);
      case Kind::kTukey: {
        const double u = s < a2 ? 1.0 - s / a2 : 0.0;
        return u * u;
      }
      case Kind::kNone:
        break;
    }
    return 1.0;
  }
};

}  // namespace raysfm
