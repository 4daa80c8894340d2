// Dimension of the kernel of the linear Pless equation (LBA09 table 2), by the singular values of 40 matches
// without noise, for matches within one camera and across cameras. Usage: pless_benchmark [problems, default
// 1000]
#include <Eigen/SVD>
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "raysfm/core/random.h"
#include "raysfm/solvers/seventeen_point.h"

namespace raysfm {
namespace {

constexpr int kMatches = 40;

Eigen::Vector3d normal_vector(Rng* rng) {
  return {rng->normal(), rng->normal(), rng->normal()};
}

int kernel_dimension(int centres, bool simple, Rng* rng) {
  std::vector<Eigen::Vector3d> origins;
  for (int i = 0; i < centres; ++i) origins.push_back(normal_vector(rng));
  const auto any = [&] { return origins[rng->index(static_cast<uint32_t>(origins.size()))]; };
  const Rigid3 rig1_from_rig0{exp_so3(0.5 * normal_vector(rng)), normal_vector(rng)};
  Eigen::Matrix<double, kMatches, 18> system;
  for (int i = 0; i < kMatches; ++i) {
    const Eigen::Vector3d point = 6 * normal_vector(rng), origin0 = any(), origin1 = simple ? origin0 : any();
    system.row(i) = pless_row({origin0, (point - origin0).normalized()},
                              {origin1, (rig1_from_rig0 * point - origin1).normalized()});
  }
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(system);
  const auto& values = svd.singularValues();
  return static_cast<int>((values.array() < 1e-9 * values[0]).count());
}

void run(int problems) {
  const struct {
    const char* name;
    int centres;
  } rigs[] = {{"central", 1}, {"axial", 2}, {"non-axial", 3}};
  for (const auto& rig : rigs) {
    for (const bool simple : {true, false}) {
      Rng rng(1, 7);
      std::vector<int> dimensions;
      for (int i = 0; i < problems; ++i) dimensions.push_back(kernel_dimension(rig.centres, simple, &rng));
      const auto [least, most] = std::ranges::minmax(dimensions);
      std::printf("%s %s %d %d\n", rig.name, simple ? "simple" : "across", least, most);
    }
  }
}

}  // namespace
}  // namespace raysfm

int main(int argc, char** argv) {
  const int problems = argc > 1 ? std::atoi(argv[1]) : 1000;
  if (problems < 1) return std::fprintf(stderr, "usage: pless_benchmark [problems]\n"), 2;
  raysfm::run(problems);
}
