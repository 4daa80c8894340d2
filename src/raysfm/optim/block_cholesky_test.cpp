#include "raysfm/optim/block_cholesky.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <vector>

#include "raysfm/core/random.h"
#include "support/instruction_sets.h"

namespace raysfm {
namespace {

// A random sparse positive definite matrix of square blocks.
struct Matrix {
  int size, n;  // blocks, numbers in a block's row
  Eigen::MatrixXd dense;
  std::vector<int> row_begin{0}, columns;

  Matrix(int size, double density, uint64_t seed, int n = 6)
      : size(size), n(n), dense(Eigen::MatrixXd::Zero(n * size, n * size)) {
    Rng rng(seed);
    Eigen::MatrixXi used = Eigen::MatrixXi::Zero(size, size);
    for (int i = 0; i < size; ++i) {
      for (int j = 0; j < i; ++j) {
        if (i != j + 1 && rng.uniform() > density) continue;
        used(i, j) = used(j, i) = 1;
        for (int r = 0; r < n; ++r) {
          for (int c = 0; c < n; ++c)
            dense(n * i + r, n * j + c) = dense(n * j + c, n * i + r) = rng.normal();
        }
      }
    }
    for (int i = 0; i < n * size; ++i) dense(i, i) = 1 + dense.row(i).cwiseAbs().sum();  // dominant: definite
    for (int i = 0; i < size; ++i) {
      for (int j = 0; j < size; ++j) {
        if (used(i, j)) columns.push_back(j);
      }
      row_begin.push_back(static_cast<int>(columns.size()));
    }
  }

  void write(BlockCholesky& cholesky) const {
    cholesky.set_zero();
    for (int i = 0; i < size; ++i) {
      for (int j = 0; j < size; ++j) {
        const int row = cholesky.position(i), column = cholesky.position(j);
        if (row < column || dense.block(n * i, n * j, n, n).isZero(0)) continue;
        Eigen::Map<Eigen::MatrixXd, 0, Eigen::OuterStride<>>(
            cholesky.values() + cholesky.offset(row, column), n, n,
            Eigen::OuterStride<>(cholesky.stride(column))) = dense.block(n * i, n * j, n, n);
      }
    }
  }
};

std::vector<double> solution(const Matrix& matrix, BlockCholesky& cholesky, int threads) {
  const int n = matrix.n;
  cholesky.analyze(matrix.size, matrix.row_begin, matrix.columns);
  matrix.write(cholesky);
  WorkTeam team(threads);
  EXPECT_TRUE(cholesky.factorize(team));
  std::vector<double> x(n * matrix.size), work(x.size()), found(x.size());
  for (int i = 0; i < matrix.size; ++i) {
    for (int k = 0; k < n; ++k) x[n * cholesky.position(i) + k] = std::sin(n * i + k);
  }
  cholesky.solve(x, work);
  for (int i = 0; i < matrix.size; ++i) {
    for (int k = 0; k < n; ++k) found[n * i + k] = x[n * cholesky.position(i) + k];
  }
  return found;
}

void expect_solves(const Matrix& matrix, BlockCholesky& cholesky) {
  const std::vector<double> x = solution(matrix, cholesky, 1);
  Eigen::VectorXd b(x.size());
  for (Eigen::Index i = 0; i < b.size(); ++i) b[i] = std::sin(i);
  const Eigen::VectorXd expected = matrix.dense.llt().solve(b);
  for (size_t i = 0; i < x.size(); ++i) ASSERT_NEAR(x[i], expected[i], 1e-12);
}

TEST(BlockCholesky, AgreesWithADenseFactor) {
  BlockCholesky poses(6), lenses(9);
  for (int size : {1, 3, 24, 25, 60, 2}) {
    for (double density : {0.0, 0.05, 0.5, 1.0}) {
      SCOPED_TRACE(testing::Message() << size << " blocks, density " << density);
      const uint64_t seed = 100 * size + static_cast<int>(10 * density);
      expect_solves(Matrix(size, density, seed), poses);
      expect_solves(Matrix(size, density, seed, 9), lenses);
    }
  }
}

TEST(BlockCholesky, ThreadsChangeNoBit) {
  for (double density : {0.01, 1.0}) {
    const Matrix matrix(90, density, 4);
    BlockCholesky one(6), three(6);
    EXPECT_EQ(solution(matrix, one, 1), solution(matrix, three, 3));
  }
}

TEST(BlockCholesky, InstructionSetsChangeNoBit) {
  const Matrix matrix(40, 0.3, 4, 9);
  std::vector<std::vector<double>> solutions;
  testing_support::for_each_instruction_set([&](const char*) {
    BlockCholesky cholesky(9);
    solutions.push_back(solution(matrix, cholesky, 1));
  });
  for (const auto& x : solutions) EXPECT_EQ(x, solutions.front());
}

// Panels hold a few zeros for the sake of larger products, but no fill of a far block.
TEST(BlockCholesky, AChainHasLittleFill) {
  const Matrix chain(100, 0.0, 5);
  BlockCholesky cholesky(6);
  cholesky.analyze(chain.size, chain.row_begin, chain.columns);
  EXPECT_LT(cholesky.value_count(), size_t(2 * 36 * 199));
}

TEST(BlockCholesky, RefusesWhatIsNotPositiveDefinite) {
  WorkTeam team;
  for (double bad : {-1.0, 0.0, double(NAN), double(INFINITY)}) {
    Matrix matrix(30, 0.1, 9);
    matrix.dense(100, 100) = bad;
    BlockCholesky cholesky(6);
    cholesky.analyze(matrix.size, matrix.row_begin, matrix.columns);
    matrix.write(cholesky);
    EXPECT_FALSE(cholesky.factorize(team)) << bad;
  }
}

TEST(BlockCholesky, NothingToSolve) {
  WorkTeam team;
  BlockCholesky cholesky(6);
  cholesky.analyze(0, {}, {});
  cholesky.set_zero();
  EXPECT_TRUE(cholesky.factorize(team));
  cholesky.solve({}, {});
}

}  // namespace
}  // namespace raysfm
