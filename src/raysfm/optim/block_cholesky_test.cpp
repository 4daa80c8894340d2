#include "raysfm/optim/block_cholesky.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "raysfm/core/random.h"

namespace raysfm {
namespace {

// A random sparse positive definite matrix of 6x6 blocks.
struct Matrix {
  int size;
  Eigen::MatrixXd dense;
  std::vector<int> row_begin{0}, columns;

  Matrix(int size, double density, uint64_t seed)
      : size(size), dense(Eigen::MatrixXd::Zero(6 * size, 6 * size)) {
    Rng rng(seed);
    Eigen::MatrixXi used = Eigen::MatrixXi::Zero(size, size);
    for (int i = 0; i < size; ++i) {
      for (int j = 0; j < i; ++j) {
        if (i != j + 1 && rng.uniform() > density) continue;
        used(i, j) = used(j, i) = 1;
        for (int r = 0; r < 6; ++r) {
          for (int c = 0; c < 6; ++c)
            dense(6 * i + r, 6 * j + c) = dense(6 * j + c, 6 * i + r) = rng.normal();
        }
      }
    }
    for (int i = 0; i < 6 * size; ++i) dense(i, i) = 1 + dense.row(i).cwiseAbs().sum();  // dominant: definite
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
        if (row < column || dense.block(6 * i, 6 * j, 6, 6).isZero(0)) continue;
        Eigen::Map<Eigen::Matrix<double, 6, 6>>(cholesky.block(cholesky.find(row, column))) =
            dense.block(6 * i, 6 * j, 6, 6);
      }
    }
  }
};

void expect_solves(const Matrix& matrix, BlockCholesky& cholesky) {
  cholesky.analyze(matrix.size, matrix.row_begin, matrix.columns);
  matrix.write(cholesky);
  ASSERT_TRUE(cholesky.factorize());
  Rng rng(7);
  Eigen::VectorXd b(6 * matrix.size);
  for (double& x : b) x = rng.normal();
  std::vector<double> x(b.size());
  for (int i = 0; i < matrix.size; ++i) {
    for (int k = 0; k < 6; ++k) x[6 * cholesky.position(i) + k] = b[6 * i + k];
  }
  cholesky.solve(x);
  const Eigen::VectorXd expected = matrix.dense.llt().solve(b);
  for (int i = 0; i < matrix.size; ++i) {
    for (int k = 0; k < 6; ++k) EXPECT_NEAR(x[6 * cholesky.position(i) + k], expected[6 * i + k], 1e-12);
  }
}

TEST(BlockCholesky, AgreesWithADenseFactor) {
  BlockCholesky cholesky;
  for (int size : {1, 3, 24, 25, 60, 2}) {
    for (double density : {0.0, 0.05, 0.5, 1.0}) {
      SCOPED_TRACE(testing::Message() << size << " blocks, density " << density);
      expect_solves(Matrix(size, density, 100 * size + static_cast<int>(10 * density)), cholesky);
    }
  }
}

TEST(BlockCholesky, AChainHasNoFill) {
  const Matrix chain(100, 0.0, 5);
  BlockCholesky cholesky;
  cholesky.analyze(chain.size, chain.row_begin, chain.columns);
  EXPECT_EQ(cholesky.block_count(), 199u);
}

TEST(BlockCholesky, RefusesWhatIsNotPositiveDefinite) {
  for (double bad : {-1.0, 0.0, double(NAN), double(INFINITY)}) {
    Matrix matrix(30, 0.1, 9);
    matrix.dense(100, 100) = bad;
    BlockCholesky cholesky;
    cholesky.analyze(matrix.size, matrix.row_begin, matrix.columns);
    matrix.write(cholesky);
    EXPECT_FALSE(cholesky.factorize()) << bad;
  }
}

TEST(BlockCholesky, NothingToSolve) {
  BlockCholesky cholesky;
  cholesky.analyze(0, {}, {});
  cholesky.set_zero();
  EXPECT_TRUE(cholesky.factorize());
  cholesky.solve({});
}

}  // namespace
}  // namespace raysfm
