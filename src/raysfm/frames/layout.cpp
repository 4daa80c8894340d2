#include "raysfm/frames/layout.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <iterator>
#include <map>

#include "raysfm/camera_files/camera_file.h"
#include "raysfm/files/text_file.h"
#include "raysfm/frames/image_source.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;

constexpr uintmax_t kMaxListBytes = 256u << 20;
constexpr int kMaxCameras = 64;

// An image file and when it was taken, as a line of a list says it.
struct ListedImage {
  double timestamp;
  std::string name;
};

bool present(const fs::path& path) {
  std::error_code failure;
  return fs::exists(path, failure);
}

bool is_folder(const fs::path& path) {
  std::error_code failure;
  return fs::is_directory(path, failure);
}

std::string where(const fs::path& path, int line) {
  return fmt::format("{}: line {}", path.string(), line);
}

// Finite and later than `previous`.
Result<double> parse_timestamp(const fs::path& path, int line, std::string_view word, double previous) {
  const std::optional<double> t = parse_number(word);
  if (!t || !std::isfinite(*t)) {
    return bad_input(fmt::format("{}: timestamp '{}'; allowed: a finite number of seconds", where(path, line),
                                 shown(word)));
  }
  if (!(*t > previous)) {
    return bad_input(fmt::format("{}: timestamp {}; allowed: later than the one before, {}",
                                 where(path, line), *t, previous));
  }
  return *t;
}

// Lines "timestamp" or, with `named`, "timestamp file".
Result<std::vector<ListedImage>> read_list(const fs::path& path, bool named) {
  const Result<std::string> text = read_text_file(path, kMaxListBytes);
  if (!text) return text.error();
  std::vector<ListedImage> images;
  double previous = -HUGE_VAL;
  for (const TextLine& line : content_lines(*text)) {
    const std::vector<std::string_view> words = split_words(line.text);
    if (words.size() != (named ? 2 : 1)) {
      return bad_input(fmt::format("{}: '{}'; allowed: {}", where(path, line.number), shown(line.text),
                                   named ? "timestamp and file name" : "one timestamp"));
    }
    const Result<double> t = parse_timestamp(path, line.number, words[0], previous);
    if (!t) return t.error();
    previous = *t;
    images.push_back({*t, std::string(named ? words[1] : "")});
  }
  if (images.empty()) return bad_input(path.string() + ": no line; allowed: one per frame");
  return images;
}

// Lines "nanoseconds,file" of EuRoC, in their order.
Result<std::map<int64_t, std::string>> read_euroc_list(const fs::path& path) {
  const Result<std::string> text = read_text_file(path, kMaxListBytes);
  if (!text) return text.error();
  std::map<int64_t, std::string> images;
  for (const TextLine& line : content_lines(*text)) {
    const std::vector<std::string_view> words = split_words(line.text, ",");
    const std::optional<int64_t> t = words.empty() ? std::nullopt : parse_integer(words[0]);
    if (words.size() != 2 || !t) {
      return bad_input(fmt::format("{}: '{}'; allowed: nanoseconds,file name", where(path, line.number),
                                   shown(line.text)));
    }
    if (!images.empty() && *t <= images.rbegin()->first) {
      return bad_input(fmt::format("{}: timestamp {}; allowed: later than the one before, {}",
                                   where(path, line.number), *t, images.rbegin()->first));
    }
    images.emplace(*t, words[1]);
  }
  return images;
}

// Opens one folder per camera with common timestamps: those of `times` where the file exists, else indices.
Result<void> open_streams(const std::vector<fs::path>& folders, const fs::path& times,
                          const InputOptions& options, Input* input) {
  std::vector<double> timestamps;
  if (present(times)) {
    const Result<std::vector<ListedImage>> list = read_list(times, false);
    if (!list) return list.error();
    for (const ListedImage& entry : *list) timestamps.push_back(entry.timestamp);
  }
  for (const fs::path& folder : folders) {
    Result<std::vector<fs::path>> files = list_images(folder);
    if (!files) return files.error();
    if (timestamps.empty() && !files->empty()) {
      timestamps = index_timestamps(files->size(), options.fps);
      input->times_are_indices = options.fps <= 0;
    }
    if (!files->empty() && files->size() != timestamps.size()) {
      return present(times)
                 ? bad_input(fmt::format("{}: {} lines; allowed: one for each of the {} images in {}",
                                         times.string(), timestamps.size(), files->size(), folder.string()))
                 : bad_input(fmt::format("{}: {} images; allowed: as many as in {}, {}", folder.string(),
                                         files->size(), folders.front().string(), timestamps.size()));
    }
    Result<std::unique_ptr<FrameSource>> stream = open_images(folder.string(), std::move(*files), timestamps);
    if (!stream) return stream.error();
    input->streams.push_back(std::move(*stream));
  }
  return {};
}

// folder/prefix0, folder/prefix1, ... as long as they exist; the first only with --mono.
std::vector<fs::path> numbered_folders(const fs::path& folder, std::string_view prefix, int first, int count,
                                       const InputOptions& options) {
  std::vector<fs::path> found;
  for (int n = first; n < first + (options.mono ? 1 : count); ++n) {
    const fs::path candidate = folder / fmt::format("{}{}", prefix, n);
    if (!is_folder(candidate)) break;
    found.push_back(candidate);
  }
  return found;
}

Result<void> read_calibration(const fs::path& path, const InputOptions& options, Input* input) {
  input->calibration_file = path;
  if (options.ignore_calibration) return {};
  Result<Rig> rig = read_camera_file(path);
  if (!rig) return rig.error();
  input->calibration = std::move(*rig);
  return {};
}

Result<void> open_euroc(const fs::path& root, const InputOptions& options, Input* input) {
  const std::vector<fs::path> folders = numbered_folders(root, "cam", 0, kMaxCameras, options);
  std::vector<std::map<int64_t, std::string>> lists;
  for (const fs::path& folder : folders) {
    Result<std::map<int64_t, std::string>> list = read_euroc_list(folder / "data.csv");
    if (!list) return list.error();
    lists.push_back(std::move(*list));
  }
  std::vector<double> timestamps;
  std::vector<std::vector<fs::path>> files(folders.size());
  for (const auto& [nanoseconds, name] : lists.front()) {
    const int64_t key = nanoseconds;
    if (!std::all_of(lists.begin(), lists.end(), [&](const auto& list) { return list.contains(key); }))
      continue;
    timestamps.push_back(static_cast<double>(nanoseconds) * 1e-9);
    for (size_t i = 0; i < folders.size(); ++i) files[i].push_back(folders[i] / "data" / lists[i].at(key));
  }
  if (timestamps.empty() && folders.size() > 1) {
    return bad_input(
        fmt::format("{}: no timestamp; allowed: some that the lists of all {} cameras have, or --mono",
                    (folders.front() / "data.csv").string(), folders.size()));
  }
  for (size_t i = 0; i < folders.size(); ++i) {
    auto stream = open_images(folders[i].string(), std::move(files[i]), timestamps);
    if (!stream) return stream.error();
    input->streams.push_back(std::move(*stream));
  }
  if (input->calibration_file || !present(folders.front() / "sensor.yaml")) return {};
  Rig rig;
  for (size_t i = 0; i < folders.size(); ++i) {
    const Result<void> read = read_calibration(folders[i] / "sensor.yaml", options, input);
    if (!read) return read;
    if (options.ignore_calibration) return {};
    rig.cameras.push_back(input->calibration->cameras.front());
    rig.cameras.back().name = fmt::format("cam{}", i);
    rig.cameras.back().stream = static_cast<int>(i);
  }
  input->calibration_file = folders.front() / "sensor.yaml";
  input->calibration = std::move(rig);
  return {};
}

Result<void> open_tum(const fs::path& folder, Input* input) {
  const Result<std::vector<ListedImage>> list = read_list(folder / "rgb.txt", true);
  if (!list) return list.error();
  std::vector<fs::path> files;
  std::vector<double> timestamps;
  for (const ListedImage& image : *list) {
    files.push_back(folder / image.name);
    timestamps.push_back(image.timestamp);
  }
  auto stream = open_images(folder.string(), std::move(files), std::move(timestamps));
  if (!stream) return stream.error();
  input->streams.push_back(std::move(*stream));
  return {};
}

Result<void> open_kitti(const fs::path& folder, const InputOptions& options, Input* input) {
  const int first = is_folder(folder / "image_0") ? 0 : 2;
  const Result<void> opened = open_streams(numbered_folders(folder, "image_", first, 2, options),
                                           folder / "times.txt", options, input);
  if (!opened) return opened;
  const fs::path calib = folder / "calib.txt";
  if (input->calibration_file || !present(calib)) return {};
  const Result<void> read = read_calibration(calib, options, input);
  if (!read || !input->calibration) return read;
  // The rig is the first camera that is used.
  Rig used;
  for (Camera& camera : input->calibration->cameras) {
    camera.stream -= first;
    if (camera.stream >= 0 && camera.stream < static_cast<int>(input->streams.size()))
      used.cameras.push_back(camera);
  }
  if (used.cameras.empty())
    return bad_input(fmt::format("{}: P{}: missing; allowed: 12 numbers", calib.string(), first));
  const Rigid3 first_from_rig = used.cameras.front().rig_from_cam.inverse();
  for (Camera& camera : used.cameras) camera.rig_from_cam = first_from_rig * camera.rig_from_cam;
  input->calibration = std::move(used);
  return {};
}

Result<void> open_sequence(const fs::path& folder, const InputOptions& options, Input* input) {
  const std::vector<fs::path> folders = is_folder(folder / "images")
                                            ? std::vector<fs::path>{folder / "images"}
                                            : numbered_folders(folder, "cam", 0, kMaxCameras, options);
  return open_streams(folders, folder / "times.txt", options, input);
}

bool is_without_images(const fs::path& folder) {
  const Result<std::vector<fs::path>> images = list_images(folder);
  return images && images->empty();
}

// The first by name of the files in a folder that are called as videos are; empty: there is none.
fs::path video_in(const fs::path& folder) {
  constexpr std::string_view kVideos[] = {".mp4", ".mov", ".m4v", ".mkv", ".webm", ".avi", ".mpg", ".mts"};
  fs::path first;
  std::error_code failure;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, failure)) {
    std::string extension = entry.path().extension().string();
    std::ranges::transform(extension, extension.begin(), [](unsigned char c) { return std::tolower(c); });
    if (std::ranges::find(kVideos, extension) == std::end(kVideos)) continue;
    if (first.empty() || entry.path() < first) first = entry.path();
  }
  return first;
}

Result<void> open_layout(const fs::path& folder, const InputOptions& options, Input* input) {
  for (const fs::path& root : {folder / "mav0", folder}) {
    if (!present(root / "cam0" / "data.csv")) continue;
    input->layout = "euroc";
    return open_euroc(root, options, input);
  }
  if (present(folder / "rgb.txt")) {
    input->layout = "tum-rgbd";
    return open_tum(folder, input);
  }
  if (is_folder(folder / "image_0") || is_folder(folder / "image_2")) {
    input->layout = "kitti";
    return open_kitti(folder, options, input);
  }
  if (is_folder(folder / "images") || is_folder(folder / "cam0")) {
    input->layout = "sequence";
    return open_sequence(folder, options, input);
  }
  input->layout = "images";
  const Result<void> opened = open_streams({folder}, {}, options, input);
  if (opened || !is_without_images(folder)) return opened;
  const fs::path video = video_in(folder);
  if (video.empty()) return opened;
  return bad_input(fmt::format("{}: no image; allowed: at least one image, or a video by its own name, as {}",
                               folder.string(), video.string()));
}

}  // namespace

Result<Input> open_folder(const fs::path& folder, const InputOptions& options) {
  Input input;
  const fs::path camera_file = folder / "camera.yaml";
  if (present(camera_file)) {
    const Result<void> read = read_calibration(camera_file, options, &input);
    if (!read) return read.error();
  }
  const Result<void> opened = open_layout(folder, options, &input);
  if (!opened) return opened.error();
  for (const char* name : {"truth.txt", "groundtruth.txt", "poses.txt"}) {
    if (!input.truth && present(folder / name)) input.truth = folder / name;
  }
  if (present(folder / "mask.png")) input.mask = folder / "mask.png";
  return input;
}

}  // namespace raysfm
