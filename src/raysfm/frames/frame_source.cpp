#include "raysfm/frames/frame_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "raysfm/frames/image_file.h"
#include "raysfm/frames/image_source.h"
#include "raysfm/frames/layout.h"
#include "raysfm/frames/video_source.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;

Result<Input> one_stream(std::string layout, Result<std::unique_ptr<FrameSource>> stream) {
  if (!stream) return stream.error();
  Input input;
  input.layout = std::move(layout);
  input.streams.push_back(std::move(*stream));
  return input;
}

Result<Input> images(const std::string& what, std::vector<fs::path> files, const InputOptions& options) {
  std::vector<double> timestamps = index_timestamps(files.size(), options.fps);
  Result<Input> input = one_stream("images", open_images(what, std::move(files), std::move(timestamps)));
  if (input) input->times_are_indices = options.fps <= 0;
  return input;
}

Result<Input> open_one(const std::string& name, const InputOptions& options) {
  const fs::path path(name);
  std::error_code failure;
  const fs::file_status status = fs::status(path, failure);
  if (fs::is_directory(status)) return open_folder(path, options);
  if (name.starts_with("/dev/video") || fs::is_character_file(status)) {
    if (auto r = register_devices(); !r) return r.error();
    return one_stream("device", open_device(name, {options.fps, options.threads}));
  }
  if (fs::is_regular_file(status)) {
    if (is_image_file(path)) return images(name, {path}, options);
    return one_stream("video", open_video(name, {options.fps, options.threads}));
  }
  if (path.filename().string().find_first_of("*?%") != std::string::npos) {
    Result<std::vector<fs::path>> files = match_images(path);
    if (!files) return files.error();
    return images(name, std::move(*files), options);
  }
  if (fs::exists(status)) return bad_input(name + ": neither a file nor a folder");
  return bad_input(name + ": no such file or folder");
}

// Gives the camera the size of its stream, or says where they differ.
Result<void> fit(const FrameSource& stream, Camera* camera) {
  const Roi& roi = camera->roi;
  if (roi.w > 0) {
    if (roi.x + roi.w <= stream.width() && roi.y + roi.h <= stream.height()) return {};
    return bad_input(fmt::format("camera {}: roi: {} x {} at ({}, {}); allowed: inside the {} x {} of {}",
                                 camera->name, roi.w, roi.h, roi.x, roi.y, stream.width(), stream.height(),
                                 stream.description()));
  }
  if (camera->width == 0) {
    camera->width = stream.width();
    camera->height = stream.height();
  }
  if (camera->width == stream.width() && camera->height == stream.height()) return {};
  return bad_input(fmt::format("camera {}: resolution: {} x {}; allowed: the {} x {} of {}", camera->name,
                               camera->width, camera->height, stream.width(), stream.height(),
                               stream.description()));
}

// Streams of images that differ in length cannot be of one rig. What a video's container says of its length
// is no proof.
Result<void> check_lengths(const Input& first, const Input& other) {
  const auto listed = [](const Input& input) { return input.layout != "video" && input.layout != "device"; };
  if (!listed(first) || !listed(other)) return {};
  const FrameSource& a = *first.streams.front();
  for (const auto& b : other.streams) {
    if (a.frame_count() == b->frame_count()) continue;
    return bad_input(fmt::format("{}: {} images; allowed: as many as in {}, {}", b->description(),
                                 b->frame_count(), a.description(), a.frame_count()));
  }
  return {};
}

}  // namespace

Result<Rig> rig_for_streams(Rig rig, const std::vector<std::unique_ptr<FrameSource>>& streams,
                            std::string* note, bool mono) {
  const int count = static_cast<int>(streams.size());
  std::string left_out;
  for (const Camera& camera : rig.cameras) {
    if (camera.stream < count) continue;
    if (!mono) {
      return bad_input(
          fmt::format("camera {}: stream: {}; allowed: 0 to {}, one for each stream of the input, or "
                      "--mono for the first alone",
                      camera.name, camera.stream, count - 1));
    }
    left_out += (left_out.empty() ? "" : ", ") + camera.name;
  }
  std::erase_if(rig.cameras, [&](const Camera& camera) { return camera.stream >= count; });
  if (note)
    *note = left_out.empty() ? "" : fmt::format("cameras without a stream are left out: {}", left_out);
  for (int i = 0; i < count; ++i) {
    if (std::any_of(rig.cameras.begin(), rig.cameras.end(),
                    [&](const Camera& camera) { return camera.stream == i; })) {
      continue;
    }
    return bad_input(fmt::format("stream {} ({}) has no camera; allowed: at least one camera with stream: {}",
                                 i, streams[i]->description(), i));
  }
  for (Camera& camera : rig.cameras) {
    const Result<void> fitted = fit(*streams[camera.stream], &camera);
    if (!fitted) return fitted.error();
  }
  return rig;
}

Result<void> check_fps(double fps) {
  constexpr double kMaxFps = 1e6;
  if (fps >= 0 && fps <= kMaxFps) return {};
  return bad_input(fmt::format("fps: {}; allowed: a number above 0, at most {:g}", fps, kMaxFps));
}

Result<Input> open_input(const std::vector<std::string>& inputs, const InputOptions& options) {
  if (inputs.empty())
    return bad_input("no input; allowed: a video, an image folder or pattern, a sequence folder");
  if (auto r = check_fps(options.fps); !r) return r.error();
  if (auto r = check_range(options.range); !r) return r.error();
  Result<Input> all = open_one(inputs.front(), options);
  if (!all) return all;
  if (inputs.size() > 1) {
    // What lies beside one stream does not describe the others.
    all->calibration.reset();
    all->calibration_file.reset();
    all->truth.reset();
    all->mask.reset();
  }
  for (size_t i = 1; i < inputs.size(); ++i) {
    Result<Input> next = open_one(inputs[i], options);
    if (!next) return next;
    if (const Result<void> alike = check_lengths(*all, *next); !alike) return alike.error();
    for (auto& stream : next->streams) all->streams.push_back(std::move(stream));
  }
  if (all->calibration) {
    Result<Rig> rig = rig_for_streams(std::move(*all->calibration), all->streams, nullptr, options.mono);
    if (!rig) return bad_input(fmt::format("{}: {}", all->calibration_file->string(), rig.error().message));
    all->calibration = std::move(*rig);
  }
  if (options.range.is_all()) return all;
  for (const auto& stream : all->streams) {
    if (auto r = stream->cut(options.range); !r) return r.error();
  }
  return all;
}

}  // namespace raysfm
