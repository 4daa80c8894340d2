#include "raysfm/results/tracks_file.h"

#include <gtest/gtest.h>

#include <fstream>

#include "raysfm/results/lens_file.h"

namespace raysfm {
namespace {

class TracksFileTest : public testing::Test {
 protected:
  void SetUp() override {
    const auto* info = testing::UnitTest::GetInstance()->current_test_info();
    path_ = std::filesystem::path(testing::TempDir()) / (std::string("tracks-") + info->name() + ".csv");
  }
  void TearDown() override { std::filesystem::remove(path_); }

  Result<TracksFile> read(const std::string& content) {
    std::ofstream(path_) << content;
    return read_tracks_file(path_);
  }
  // The message without the name of the file.
  std::string complaint(const std::string& content) {
    const Result<TracksFile> file = read(content);
    if (file) return "none";
    EXPECT_EQ(file.error().kind, ErrorKind::kBadInput);
    return file.error().message.substr(path_.string().size());
  }

  std::filesystem::path path_;
};

TEST_F(TracksFileTest, NumbersOfImagesAreTheirOrderAndTime) {
  const auto file = read("image,point,u,v\n10,a,1.5,2\n# not this\n\n9,a,3,4\n9, b ,5,6\r\n");
  ASSERT_TRUE(file.ok()) << file.error().message;
  EXPECT_EQ(file->images, (std::vector<std::string>{"9", "10"}));
  EXPECT_EQ(file->timestamps, (std::vector<double>{9, 10}));
  EXPECT_EQ(file->points, (std::vector<std::string>{"a", "b"}));
  EXPECT_EQ(file->image, (std::vector<int>{1, 0, 0}));
  EXPECT_EQ(file->point, (std::vector<int>{0, 0, 1}));
  EXPECT_EQ(file->pixel[0], Eigen::Vector2d(1.5, 2));
}

TEST_F(TracksFileTest, NamesOfImagesAreInAlphabeticalOrder) {
  const auto file = read("image,point,u,v\nb.png,1,1,2\n10,1,3,4\n");
  ASSERT_TRUE(file.ok()) << file.error().message;
  EXPECT_EQ(file->images, (std::vector<std::string>{"10", "b.png"}));
  EXPECT_EQ(file->timestamps, (std::vector<double>{0, 1}));
  EXPECT_EQ(file->image, (std::vector<int>{1, 0}));
}

TEST_F(TracksFileTest, SaysWhatIsWrongAndWhere) {
  const std::string head = "image,point,u,v\n";
  EXPECT_EQ(complaint(""), ":1: '' is not allowed, the header line image,point,u,v is");
  EXPECT_EQ(complaint("1,2,3,4\n"), ":1: '1,2,3,4' is not allowed, the header line image,point,u,v is");
  EXPECT_EQ(complaint(head + "1,1,nan,4\n"),
            ":2: u = 'nan' is not allowed, a number from -1000000 to 1000000 is");
  EXPECT_EQ(complaint(head + "1,1,3,x\n"),
            ":2: v = 'x' is not allowed, a number from -1000000 to 1000000 is");
  EXPECT_EQ(complaint(head + "1,1,3\n"), ":2: '1,1,3' is not allowed, four fields are: image,point,u,v");
  EXPECT_EQ(complaint(head + "1,,3,4\n"), ":2: '1,,3,4' is not allowed, four fields are: image,point,u,v");
  EXPECT_EQ(complaint(head + "1,1,3,4,5\n"),
            ":2: '1,1,3,4,5' is not allowed, four fields are: image,point,u,v");
  EXPECT_EQ(complaint(head + "1,1,3,4\n2,1,3,4\n\n1,1,5,6\n"),
            ":5: point '1' is seen in image '1' a second time, once is allowed");
}

TEST_F(TracksFileTest, StructureIsPointsAndPositions) {
  std::ofstream(path_) << "point,x,y,z\na,1,2.5,-3\n# board\n7,0,0,1e2\n";
  const auto file = read_structure_file(path_);
  ASSERT_TRUE(file.ok()) << file.error().message;
  EXPECT_EQ(file->points, (std::vector<std::string>{"a", "7"}));
  EXPECT_EQ(file->positions[0], Eigen::Vector3d(1, 2.5, -3));
  EXPECT_EQ(file->positions[1], Eigen::Vector3d(0, 0, 100));
  const auto complaint = [&](const std::string& content) {
    std::ofstream(path_) << content;
    const auto read = read_structure_file(path_);
    return read ? "none" : read.error().message.substr(path_.string().size());
  };
  EXPECT_EQ(complaint("image,point,u,v\n"),
            ":1: 'image,point,u,v' is not allowed, the header line point,x,y,z is");
  EXPECT_EQ(complaint("point,x,y,z\na,1,2\n"), ":2: 'a,1,2' is not allowed, four fields are: point,x,y,z");
  EXPECT_EQ(complaint("point,x,y,z\na,1,2,inf\n"),
            ":2: z = 'inf' is not allowed, a number from -1000000000 to 1000000000 is");
  EXPECT_EQ(complaint("point,x,y,z\na,1,2,3\nb,1,2,3\na,1,2,3\n"),
            ":4: point 'a' is there a second time, once is allowed");
}

TEST_F(TracksFileTest, IsKnownByNameOrContent) {
  std::ofstream(path_) << "x";
  EXPECT_TRUE(is_tracks_file(path_));
  const std::filesystem::path other = path_.string() + ".dat";
  std::ofstream(other) << "image,point,u,v\n";
  EXPECT_TRUE(is_tracks_file(other));
  std::ofstream(other) << "image point\n";
  EXPECT_FALSE(is_tracks_file(other));
  std::filesystem::remove(other);
  EXPECT_FALSE(is_tracks_file(path_.parent_path()));
}

TEST_F(TracksFileTest, LensFileHasAColumnForEachNumber) {
  const LensOfFrame lens{0.5, {500, 501, 320, 240, 0}, {1, 2, 3, INFINITY, 0}};
  ASSERT_TRUE(write_lens_file({&lens, 1}, path_).ok());
  std::ifstream file(path_);
  std::string header, line;
  std::getline(file, header);
  std::getline(file, line);
  EXPECT_EQ(header, "timestamp,fx,fy,cx,cy,skew,fx_sigma,fy_sigma,cx_sigma,cy_sigma,skew_sigma");
  EXPECT_EQ(line, "0.500000000,500.000000,501.000000,320.000000,240.000000,0.000000,1,2,3,inf,0");
}

// Nine decimals would make one timestamp of them.
TEST_F(TracksFileTest, LensesAPicosecondApartAreToldApart) {
  const LensOfFrame lenses[] = {{1, {}, {}}, {1 + 1e-12, {}, {}}};
  ASSERT_TRUE(write_lens_file(lenses, path_).ok());
  std::ifstream file(path_);
  std::string line;
  std::getline(file, line);
  for (const LensOfFrame& lens : lenses) {
    std::getline(file, line);
    EXPECT_EQ(std::stod(line), lens.timestamp) << line;
  }
}

}  // namespace
}  // namespace raysfm
