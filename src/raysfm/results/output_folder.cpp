#include "raysfm/results/output_folder.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <nlohmann/json.hpp>
#include <optional>
#include <system_error>
#include <utility>

#include "raysfm/files/atomic_file.h"
#include "raysfm/files/staged_folder.h"
#include "raysfm/files/text_file.h"
#include "raysfm/results/world_writers.h"
#include "raysfm/scene/worlds.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr const char *kReport = "report.json", *kFailed = "failed.json", *kConfig = "config.yaml",
                     *kPage = "report.html";

PageWriter page_writer;

void append(const PosedFrame& frame, Trajectory* trajectory) {
  if (!frame.world_from_rig) return;
  trajectory->timestamps.push_back(frame.timestamp);
  trajectory->world_from_cam.push_back(*frame.world_from_rig);
}

// Empty where there is none, null where it is no JSON.
std::optional<Json> report_of(const fs::path& folder) {
  std::error_code missing;
  if (!fs::is_regular_file(folder / kReport, missing)) return std::nullopt;
  const Result<std::string> text = read_text_file(folder / kReport, kMaxReportBytes);
  Json json = text ? Json::parse(*text, nullptr, false) : Json();
  return json.is_object() ? std::move(json) : Json();
}

// Whether report.json of the folder tells of a frame with a pose, or cannot be understood.
bool holds_result(const fs::path& folder) {
  const std::optional<Json> report = report_of(folder);
  if (!report) return false;
  const auto posed =
      report->is_object() ? report->value(Json::json_pointer("/frames/posed"), Json()) : Json();
  return !posed.is_number() || posed > 0;
}

// The files that report.json of the folder says to be its own, relative to the folder.
std::vector<std::string> files_of_result(const fs::path& folder) {
  const std::optional<Json> report = report_of(folder);
  if (!report || !report->is_object()) return {};
  std::vector<std::string> files = {kFailed};
  // Version 0.1.0 of `solve` did not list its files.
  if (report->contains("lens") && !report->contains("files")) {
    files.insert(files.end(), {"lens.csv", "lens.png"});
  }
  for (const Json& name : report->value("files", Json::array())) {
    if (name.is_string() && stays_below(name.get<std::string>())) files.push_back(name.get<std::string>());
  }
  return files;
}

Result<void> write_worlds(const Reconstruction& reconstruction, const fs::path& folder) {
  const std::vector<int> order = worlds_in_order(reconstruction);
  // One world needs no second copy of itself.
  if (reconstruction.segments.size() <= 1) return write_world(reconstruction, folder);
  for (size_t i = 0; i < order.size(); ++i) {
    const Reconstruction world = world_of(reconstruction, order[i]);
    if (auto r = write_world(world, folder / world_folder(static_cast<int>(i))); !r) return r;
  }
  return {};
}

Result<void> write_contents(const Reconstruction& reconstruction, Report report, const std::string& config,
                            std::span<const ResultFile> more, const fs::path& folder) {
  if (auto r = write_worlds(reconstruction, folder); !r) return r;
  for (const ResultFile& file : more) {
    if (auto r = file.write(folder / file.name); !r) return r;
  }
  if (auto r = write_file(folder / kConfig, config); !r) return r;
  if (page_writer) {
    if (auto r = page_writer(reconstruction, report, folder / kPage); !r) return r;
  }
  report.files = files_below(folder);
  report.files.emplace_back(kReport);
  return write_report(reconstruction, report, folder / kReport);
}

}  // namespace

void set_page_writer(PageWriter writer) {
  page_writer = std::move(writer);
}

Trajectory posed_frames(const Reconstruction& reconstruction) {
  Trajectory trajectory;
  for (const PosedFrame& frame : reconstruction.frames) append(frame, &trajectory);
  return trajectory;
}

Trajectory posed_keyframes(const Reconstruction& reconstruction) {
  Trajectory trajectory;
  for (const KeyFrame& keyframe : reconstruction.keyframes) {
    append(reconstruction.frames[keyframe.frame], &trajectory);
  }
  return trajectory;
}

Result<void> prepare_output_folder(const fs::path& folder) {
  if (auto created = create_folder(folder); !created) return created;
  // Permission bits do not tell: root passes them and a read-only file system does not have them.
  std::string probe = (folder / ".raysfm-XXXXXX").string();
  const int file = ::mkstemp(probe.data());
  if (file < 0) {
    return bad_input(
        fmt::format("{}: files cannot be written to this folder: {}", folder.string(), std::strerror(errno)));
  }
  ::close(file);
  ::unlink(probe.c_str());
  return {};
}

Result<void> check_output_folder(const fs::path& folder, std::span<const std::string> inputs,
                                 std::span<const std::string> more) {
  std::vector<std::string> replaced = files_of_result(folder);
  replaced.insert(replaced.end(), more.begin(), more.end());
  replaced.insert(replaced.end(), {kReport, kFailed, kConfig, kPage});
  for (const WorldWriter& writer : world_writers()) replaced.push_back(writer.name);
  for (const std::string& name : replaced) {
    if (auto r = check_not_input("--out", folder / name, inputs); !r) return r;
  }
  return {};
}

Result<bool> write_output_folder(const Reconstruction& reconstruction, Report report,
                                 const std::string& config, const fs::path& folder,
                                 std::span<const ResultFile> more) {
  if (posed_count(reconstruction) == 0 && holds_result(folder)) {
    if (auto r = write_report(reconstruction, report, folder / kFailed); !r) return r.error();
    return false;
  }
  Result<StagedFolder> staged = StagedFolder::create(folder);
  if (!staged) return staged.error();
  Result<void> written = write_contents(reconstruction, std::move(report), config, more, staged->path());
  if (written) written = staged->commit(files_of_result(folder), kReport);
  return written ? Result<bool>(true) : staged->in_place(written.error());
}

}  // namespace raysfm
