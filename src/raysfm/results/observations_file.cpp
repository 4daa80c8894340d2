#include "raysfm/results/observations_file.h"

#include <fmt/format.h>

#include <cmath>
#include <iterator>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "raysfm/colmap_bal/colmap_model.h"
#include "raysfm/files/atomic_file.h"
#include "raysfm/files/text_file.h"

namespace raysfm {
namespace {

constexpr std::string_view kObservationsHeader = "keyframe,camera,point,u,v";
constexpr uintmax_t kMaxObservationsBytes = uintmax_t{4} << 30;
constexpr int kMostRigCameras = 1 << 16;

struct ObservationRow {
  int64_t keyframe = 0;
  Observation observation;
};

std::optional<ObservationRow> parse_row(std::string_view line, int keyframes, int64_t points) {
  const std::vector<std::string_view> words = split_words(line, ",");
  if (words.size() != 5) return std::nullopt;
  const std::optional<int64_t> keyframe = parse_integer(words[0]), camera = parse_integer(words[1]),
                               point = parse_integer(words[2]);
  const std::optional<double> u = parse_number(words[3]), v = parse_number(words[4]);
  const auto below = [](const std::optional<int64_t>& number, int64_t end) {
    return number && *number >= 0 && *number < end;
  };
  if (!below(keyframe, keyframes) || !below(camera, kMostRigCameras) || !below(point, points) || !u || !v ||
      !std::isfinite(*u) || !std::isfinite(*v)) {
    return std::nullopt;
  }
  return ObservationRow{*keyframe, {static_cast<int>(*point), static_cast<int>(*camera), {*u, *v}}};
}

}  // namespace

Result<void> write_observations_csv(const Reconstruction& world, const std::filesystem::path& path) {
  if (is_colmap_model(path.parent_path() / "sparse")) return {};
  std::string text = fmt::format("{}\n", kObservationsHeader);
  const auto out = std::back_inserter(text);
  for (size_t k = 0; k < world.keyframes.size(); ++k) {
    const KeyFrame& keyframe = world.keyframes[k];
    for (int i = keyframe.first_observation; i < keyframe.last_observation; ++i) {
      const Observation& o = world.observations[i];
      fmt::format_to(out, "{},{},{},{},{}\n", k, o.camera, o.point, o.pixel.x(), o.pixel.y());
    }
  }
  return write_file(path, text);
}

Result<void> read_observations_csv(const std::filesystem::path& path, int keyframes, int first_point,
                                   Reconstruction* r) {
  const Result<std::string> text = read_text_file(path, kMaxObservationsBytes);
  if (!text) return text.error();
  const std::vector<TextLine> lines = content_lines(*text);
  if (lines.empty() || lines[0].text != kObservationsHeader) {
    return bad_input(
        fmt::format("{}: does not begin with the header line {}", path.string(), kObservationsHeader));
  }
  const auto points = static_cast<int64_t>(r->points.size()) - first_point;
  const size_t first_keyframe = r->keyframes.size() - static_cast<size_t>(keyframes);
  size_t next = first_keyframe;
  const auto begin_before = [&](size_t end) {
    const int here = static_cast<int>(r->observations.size());
    for (; next < end; ++next) {
      if (next > first_keyframe) r->keyframes[next - 1].last_observation = here;
      r->keyframes[next].first_observation = r->keyframes[next].last_observation = here;
    }
  };
  for (size_t i = 1; i < lines.size(); ++i) {
    std::optional<ObservationRow> row = parse_row(lines[i].text, keyframes, points);
    if (!row || first_keyframe + static_cast<size_t>(row->keyframe) + 1 < next) {
      return bad_input(fmt::format("{}:{}: '{}' is not allowed, {} in the order of key frames is",
                                   path.string(), lines[i].number, shown(lines[i].text),
                                   kObservationsHeader));
    }
    begin_before(first_keyframe + static_cast<size_t>(row->keyframe) + 1);
    row->observation.point += first_point;
    r->observations.push_back(row->observation);
  }
  begin_before(r->keyframes.size());
  if (keyframes > 0) r->keyframes.back().last_observation = static_cast<int>(r->observations.size());
  return {};
}

}  // namespace raysfm
