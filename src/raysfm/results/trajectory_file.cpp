#include "raysfm/results/trajectory_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <optional>
#include <string_view>
#include <vector>

#include "raysfm/files/atomic_file.h"
#include "raysfm/files/text_file.h"
#include "raysfm/results/world_writers.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;

constexpr uintmax_t kMaxTrajectoryBytes = 256u << 20;
constexpr size_t kTumNumbers = 8;
constexpr size_t kKittiNumbers = 12;
constexpr size_t kEurocNumbers = 8;  // the velocity and the biases behind them are passed over
constexpr double kMaxNumber = 1e12;  // keeps every sum of squares finite
constexpr double kRotationTolerance = 1e-3;
constexpr double kUnitTolerance = 1e-14;  // of the squared length of a quaternion that is rounded to a double

// One line of numbers of a text file.
struct NumberLine {
  int line = 0;  // counted from 1
  size_t count = 0;
  std::array<double, kKittiNumbers> values{};  // the first `count`
};

Result<NumberLine> parse_line(const fs::path& path, const TextLine& text, std::string_view separators = "",
                              size_t first_field = 1) {
  NumberLine line;
  line.line = text.number;
  for (const std::string_view word : split_words(text.text, separators)) {
    const std::optional<double> value = parse_number(word);
    if (!value || !(std::abs(*value) <= kMaxNumber)) {
      return bad_input(fmt::format("{}:{}: field {}: '{}' is not allowed, a number of at most {:g} is",
                                   path.string(), text.number, line.count + first_field, shown(word),
                                   kMaxNumber));
    }
    if (line.count < line.values.size()) line.values[line.count] = *value;
    ++line.count;
  }
  return line;
}

// Calls parse(line) for every line that is neither empty nor a comment.
template <typename Parse>
Result<void> for_each_line(const fs::path& path, std::string_view text, Parse parse) {
  for (const TextLine& text_line : content_lines(text)) {
    const Result<NumberLine> line = parse_line(path, text_line);
    if (!line) return line.error();
    if (Result<void> parsed = parse(*line); !parsed) return parsed;
  }
  return {};
}

Result<void> check_order(const fs::path& path, int line, double timestamp,
                         const std::vector<double>& before) {
  if (before.empty() || timestamp > before.back()) return {};
  return bad_input(fmt::format("{}:{}: timestamp: {} is not allowed, it must be greater than {} before it",
                               path.string(), line, timestamp, before.back()));
}

Result<Rigid3> quaternion_pose(const fs::path& path, int line, const char* order,
                               const Eigen::Quaterniond& rotation, const Eigen::Vector3d& translation) {
  if (!(std::abs(rotation.norm() - 1.0) <= kRotationTolerance)) {
    return bad_input(fmt::format("{}:{}: {}: a quaternion of length {} is not allowed, 1 +- {} is",
                                 path.string(), line, order, rotation.norm(), kRotationTolerance));
  }
  // One that was written by us comes back bit by bit.
  const bool exact = std::abs(rotation.squaredNorm() - 1.0) <= kUnitTolerance;
  return Rigid3{exact ? rotation : rotation.normalized(), translation};
}

Result<Rigid3> tum_pose(const fs::path& path, const NumberLine& line) {
  const auto& v = line.values;
  return quaternion_pose(path, line.line, "qx qy qz qw", {v[7], v[4], v[5], v[6]}, {v[1], v[2], v[3]});
}

Result<Rigid3> kitti_pose(const fs::path& path, const NumberLine& line) {
  const Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>> matrix(line.values.data());
  const Eigen::Matrix3d rotation = matrix.leftCols<3>();
  const Eigen::Quaterniond quaternion = Eigen::Quaterniond(rotation).normalized();
  const double deviation = (quaternion.toRotationMatrix() - rotation).cwiseAbs().maxCoeff();
  if (!(deviation <= kRotationTolerance)) {
    return bad_input(fmt::format("{}:{}: R: a matrix {} away from a rotation is not allowed, at most {} is",
                                 path.string(), line.line, deviation, kRotationTolerance));
  }
  return Rigid3{quaternion, matrix.col(3)};
}

Result<std::vector<double>> read_times(const fs::path& path) {
  const Result<std::string> text = read_text_file(path, kMaxTrajectoryBytes);
  if (!text) return text.error();
  std::vector<double> times;
  const Result<void> read = for_each_line(path, *text, [&](const NumberLine& line) -> Result<void> {
    if (line.count != 1) {
      return bad_input(fmt::format("{}:{}: {} numbers are not allowed, one timestamp is", path.string(),
                                   line.line, line.count));
    }
    if (auto ordered = check_order(path, line.line, line.values[0], times); !ordered) return ordered;
    times.push_back(line.values[0]);
    return {};
  });
  if (!read) return read.error();
  return times;
}

// Timestamps of KITTI poses: times.txt beside them, or the index.
Result<std::vector<double>> kitti_times(const fs::path& poses, size_t count) {
  const fs::path path = poses.parent_path() / "times.txt";
  std::vector<double> times;
  if (!fs::exists(path)) {
    for (size_t i = 0; i < count; ++i) times.push_back(static_cast<double>(i));
    return times;
  }
  Result<std::vector<double>> read = read_times(path);
  if (read && read->size() != count) {
    return bad_input(fmt::format("{}: {} timestamps are not allowed, {} has {} poses", path.string(),
                                 read->size(), poses.string(), count));
  }
  return read;
}

// One line of EuRoC's truth. Nanoseconds since 1970 have too many digits for a double.
Result<void> append_euroc_pose(const fs::path& path, const TextLine& text, Trajectory* trajectory) {
  const std::string_view word = text.text.substr(0, text.text.find(','));
  const std::optional<int64_t> nanoseconds = parse_integer(word);
  if (!nanoseconds) {
    return bad_input(fmt::format("{}:{}: timestamp: '{}' is not allowed, whole nanoseconds are",
                                 path.string(), text.number, shown(word)));
  }
  const Result<NumberLine> line =
      parse_line(path, {text.number, text.text.substr(std::min(word.size() + 1, text.text.size()))}, ",", 2);
  if (!line) return line.error();
  if (line->count + 1 < kEurocNumbers) {
    return bad_input(
        fmt::format("{}:{}: {} numbers are not allowed, at least 8 (timestamp, x, y, z, qw, qx, qy, qz) are",
                    path.string(), text.number, line->count + 1));
  }
  const double timestamp = static_cast<double>(*nanoseconds) / 1e9;
  if (auto ordered = check_order(path, text.number, timestamp, trajectory->timestamps); !ordered)
    return ordered;
  const auto& v = line->values;
  const Result<Rigid3> pose =
      quaternion_pose(path, text.number, "qw qx qy qz", {v[3], v[4], v[5], v[6]}, {v[0], v[1], v[2]});
  if (!pose) return pose.error();
  trajectory->timestamps.push_back(timestamp);
  trajectory->world_from_cam.push_back(*pose);
  return {};
}

// EuRoC's truth, the only format with commas; nullopt where the text is none.
std::optional<Result<Trajectory>> read_euroc(const fs::path& path, std::string_view text) {
  const std::vector<TextLine> lines = content_lines(text);
  if (lines.empty() || lines.front().text.find(',') == std::string_view::npos) return std::nullopt;
  Trajectory trajectory;
  for (const TextLine& line : lines) {
    if (auto read = append_euroc_pose(path, line, &trajectory); !read) return read.error();
  }
  return trajectory;
}

Result<fs::path> trajectory_in(const fs::path& folder) {
  for (const char* name :
       {"trajectory.txt", "truth.txt", "poses.txt", "groundtruth.txt", "state_groundtruth_estimate0/data.csv",
        "mav0/state_groundtruth_estimate0/data.csv"}) {
    if (fs::exists(folder / name)) return folder / name;
  }
  return bad_input(fmt::format(
      "{}: no trajectory in this folder; trajectory.txt, truth.txt, poses.txt, groundtruth.txt or "
      "state_groundtruth_estimate0/data.csv is expected",
      folder.string()));
}

}  // namespace

Result<Trajectory> read_trajectory(const fs::path& path) {
  std::error_code failure;
  if (fs::is_directory(path, failure)) {
    const Result<fs::path> file = trajectory_in(path);
    if (!file) return file.error();
    return read_trajectory(*file);
  }
  const Result<std::string> text = read_text_file(path, kMaxTrajectoryBytes);
  if (!text) return text.error();
  if (std::optional<Result<Trajectory>> euroc = read_euroc(path, *text)) return *std::move(euroc);

  Trajectory trajectory;
  size_t expected = 0;  // numbers per line, decided by the first
  const Result<void> read = for_each_line(path, *text, [&](const NumberLine& line) -> Result<void> {
    if (expected == 0) expected = line.count == kKittiNumbers ? kKittiNumbers : kTumNumbers;
    if (line.count != expected) {
      return bad_input(fmt::format(
          "{}:{}: {} numbers are not allowed, {} are", path.string(), line.line, line.count,
          expected == kTumNumbers ? "8 (timestamp tx ty tz qx qy qz qw)" : "12 (a 3 x 4 matrix by rows)"));
    }
    const bool tum = expected == kTumNumbers;
    if (tum) {
      if (auto ordered = check_order(path, line.line, line.values[0], trajectory.timestamps); !ordered) {
        return ordered;
      }
      trajectory.timestamps.push_back(line.values[0]);
    }
    const Result<Rigid3> pose = tum ? tum_pose(path, line) : kitti_pose(path, line);
    if (!pose) return pose.error();
    trajectory.world_from_cam.push_back(*pose);
    return {};
  });
  if (!read) return read.error();
  if (trajectory.world_from_cam.empty()) return bad_input(fmt::format("{}: no poses", path.string()));
  if (expected == kKittiNumbers) {
    Result<std::vector<double>> times = kitti_times(path, trajectory.world_from_cam.size());
    if (!times) return times.error();
    trajectory.timestamps = std::move(*times);
  }
  return trajectory;
}

Result<std::vector<fs::path>> trajectories_of_worlds(const fs::path& path) {
  std::error_code failure;
  Result<fs::path> main = path;
  if (fs::is_directory(path, failure)) main = trajectory_in(path);
  if (!main) return main.error();
  std::vector<fs::path> worlds = {*main};
  for (int number = 1;; ++number) {
    const fs::path other = main->parent_path() / world_folder(number) / main->filename();
    if (!fs::is_regular_file(other, failure)) return worlds;
    worlds.push_back(other);
  }
}

Result<void> write_trajectory(const Trajectory& trajectory, const std::string& header, const fs::path& path) {
  std::string text;
  for (std::string_view rest = header; !rest.empty();) {
    const std::string_view line = rest.substr(0, rest.find('\n'));
    text += fmt::format("# {}\n", line);
    rest.remove_prefix(std::min(line.size() + 1, rest.size()));
  }
  for (int i = 0; i < trajectory.size(); ++i) {
    const Eigen::Vector3d& t = trajectory.world_from_cam[i].translation;
    const Eigen::Quaterniond& q = trajectory.world_from_cam[i].rotation;
    fmt::format_to(std::back_inserter(text), "{} {} {} {} {} {} {} {}\n",
                   timestamp_text(trajectory.timestamps[i]), t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w());
  }
  return write_file(path, text);
}

}  // namespace raysfm
