#include "raysfm/results/covariance_file.h"

#include <fmt/format.h>

#include <iterator>
#include <string>

#include "raysfm/files/atomic_file.h"
#include "raysfm/files/text_file.h"

namespace raysfm {
namespace {

constexpr uintmax_t kMaxBytes = 1u << 30;

}  // namespace

Result<void> write_covariance_csv(const Reconstruction& world, const std::filesystem::path& path) {
  const char* const names[] = {"vx", "vy", "vz", "wx", "wy", "wz"};
  const char* const unit = world.metric_scale ? "metres" : "arbitrary units of trajectory.txt";
  std::string text = fmt::format(
      "# covariance of world_from_rig in trajectory.txt; with respect to what: docs/conventions.md\n"
      "# tangent (vx, vy, vz, wx, wy, wz), applied on the left, in the axes of the world: R <- exp(w) R, t "
      "<- t + v\n"
      "# upper triangle by rows; v in {}, w in radians\n"
      "timestamp",
      unit);
  for (int i = 0; i < 6; ++i) {
    for (int j = i; j < 6; ++j) text += fmt::format(",{}_{}", names[i], names[j]);
  }
  text += '\n';
  for (const PosedFrame& frame : world.frames) {
    if (!frame.world_from_rig) continue;
    text += timestamp_text(frame.timestamp);
    for (int i = 0; i < 6; ++i) {
      for (int j = i; j < 6; ++j) fmt::format_to(std::back_inserter(text), ",{}", frame.covariance(i, j));
    }
    text += '\n';
  }
  return write_file(path, text);
}

Result<std::vector<Matrix6d>> read_covariance_csv(const std::filesystem::path& path) {
  const Result<std::string> text = read_text_file(path, kMaxBytes);
  if (!text) return text.error();
  std::vector<Matrix6d> covariances;
  for (const TextLine& line : content_lines(*text)) {
    const std::vector<std::string_view> words = split_words(line.text, ",");
    if (words.size() == 22 && words[0] == "timestamp") continue;
    Matrix6d& covariance = covariances.emplace_back();
    for (size_t i = 0, next = 1; i < 6; ++i) {
      for (size_t j = i; j < 6; ++j, ++next) {
        const auto value = words.size() == 22 ? parse_number(words[next]) : std::nullopt;
        if (!value) {
          return bad_input(fmt::format("{}:{}: '{}' is not allowed, a timestamp and 21 numbers are",
                                       path.string(), line.number, shown(line.text)));
        }
        covariance(i, j) = covariance(j, i) = *value;
      }
    }
  }
  return covariances;
}

}  // namespace raysfm
