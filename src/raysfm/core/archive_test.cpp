#include "raysfm/core/archive.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <string>
#include <vector>

namespace raysfm {
namespace {

struct Everything {
  int number = 0;
  std::string text;
  std::vector<double> flat;
  std::vector<std::string> nested;
  std::optional<int> may_be;
  Eigen::Vector3d fixed = Eigen::Vector3d::Zero();
  Eigen::VectorXd vector;
  Eigen::MatrixXd matrix;

  bool operator==(const Everything&) const = default;
};

template <typename A>
void archive_fields(A& a, Everything& x) {
  archive(a, x.number, x.text, x.flat, x.nested, x.may_be, x.fixed, x.vector, x.matrix);
}

Everything everything() {
  return {7,
          "seven",
          {1, 2, 3},
          {"a", "", "bc"},
          4,
          {5, 6, 7},
          Eigen::VectorXd::LinSpaced(5, 0, 1),
          Eigen::MatrixXd::Identity(2, 3)};
}

template <typename T>
std::string written(T x) {
  ArchiveWriter writer;
  archive(writer, x);
  return writer.content();
}

TEST(Archive, ReadsWhatItWrote) {
  const std::string state = written(everything());
  ArchiveReader reader(state);
  Everything read;
  archive(reader, read);
  EXPECT_TRUE(reader.at_end());
  EXPECT_EQ(read, everything());
}

TEST(Archive, WhatEndsTooSoonIsRefused) {
  const std::string state = written(everything());
  for (size_t size = 0; size < state.size(); ++size) {
    ArchiveReader reader(std::string_view(state).substr(0, size));
    Everything read;
    archive(reader, read);
    EXPECT_FALSE(reader.good()) << size;
  }
}

TEST(Archive, AVectorHasOneColumn) {
  const std::string state = written(Eigen::MatrixXd(Eigen::MatrixXd::Identity(2, 3)));
  ArchiveReader reader(state);
  Eigen::VectorXd read = Eigen::VectorXd::Ones(4);
  archive(reader, read);
  EXPECT_FALSE(reader.good());
  EXPECT_EQ(read.size(), 0);
}

}  // namespace
}  // namespace raysfm
