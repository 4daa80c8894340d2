#include "raysfm/api/checkpoint.h"

#include <fmt/format.h>
#include <libdeflate.h>

#include <algorithm>
#include <limits>
#include <utility>

#include "raysfm/camera_files/camera_file.h"
#include "raysfm/files/atomic_file.h"
#include "raysfm/files/text_file.h"
#include "raysfm/settings/config.h"

namespace raysfm {
namespace {

// Another layout of the state is not read.
constexpr std::string_view kCheckpointHeader = "raysfm checkpoint 8\n";
constexpr double kLeastWaitMs = 1000, kShareOfTime = 0.02;

uint32_t sum_of(uint32_t before, std::string_view bytes) {
  return bytes.empty() ? before : libdeflate_crc32(before, bytes.data(), bytes.size());
}

// What a checkpoint holds beside the state of the tracker.
struct CheckpointContent {
  std::string identity;
  int frames = 0;
  uint32_t frames_sum = 0;
  std::vector<int> needed, detected;  // of the views
  std::string state;

  template <typename A>
  void archive(A& a) {
    raysfm::archive(a, identity, frames, frames_sum, needed, detected, state);
  }
};

// Nothing where the file is not whole.
std::optional<CheckpointContent> parse_checkpoint(std::string_view text) {
  uint32_t sum = 0;
  if (text.size() < kCheckpointHeader.size() + sizeof sum || !text.starts_with(kCheckpointHeader))
    return std::nullopt;
  std::memcpy(&sum, text.data() + text.size() - sizeof sum, sizeof sum);
  text.remove_suffix(sizeof sum);
  if (sum_of(0, text) != sum) return std::nullopt;
  ArchiveReader reader(text.substr(kCheckpointHeader.size()));
  CheckpointContent content;
  archive(reader, content);
  if (!reader.at_end() || content.needed.size() != content.detected.size()) return std::nullopt;
  return content;
}

std::string checkpoint_text(CheckpointContent content) {
  ArchiveWriter writer;
  archive(writer, content);
  std::string text = std::string(kCheckpointHeader) + writer.content();
  const uint32_t sum = sum_of(0, text);
  text.append(reinterpret_cast<const char*>(&sum), sizeof sum);
  return text;
}

// The first line of `now` that `then` does not have.
std::string first_difference(const std::string& then, const std::string& now) {
  const std::vector<TextLine> before = content_lines(then);
  for (const TextLine& line : content_lines(now)) {
    if (std::ranges::find(before, line.text, &TextLine::text) == before.end())
      return shown(trimmed(line.text));
  }
  return "input";
}

}  // namespace

std::string run_identity(TrackSettings settings, const Rig& rig) {
  settings.threads = 0;  // changes no result
  std::string identity = effective_config(settings, settings.program_version);
  if (!settings.map.empty()) {
    const Result<std::string> map = read_text_file(settings.map, std::numeric_limits<uintmax_t>::max());
    identity += fmt::format("content of map: {:08x}\n", map ? sum_of(0, *map) : 0);
  }
  return identity + format_camera_file(rig);
}

Result<void> Checkpoint::read(const EventSink& event) {
  if (path_.empty()) return {};
  std::error_code failure;
  if (!std::filesystem::exists(path_, failure)) {
    tell(event, Event::Level::kInfo, "nothing to go on from, starts anew");
    return {};
  }
  const Result<std::string> text = read_text_file(path_, std::numeric_limits<uintmax_t>::max());
  std::optional<CheckpointContent> content = text ? parse_checkpoint(*text) : std::nullopt;
  if (!content) {
    tell(event, Event::Level::kWarning,
         fmt::format("{}: not a whole checkpoint of this version, starts anew", path_.string()));
    return {};
  }
  if (content->identity != identity_) {
    return bad_input(
        fmt::format("{}: of another run, which had not '{}'; allowed: the same settings, or to "
                    "remove it",
                    path_.string(), first_difference(content->identity, identity_)));
  }
  passed_.end = content->frames;
  for (size_t i = 0; i < content->needed.size(); ++i) {
    passed_.needed[content->needed[i]] = content->detected[i] != 0;
  }
  passed_sum_ = content->frames_sum;
  state_ = std::move(content->state);
  tell(event, Event::Level::kInfo, fmt::format("goes on from frame {}", passed_.end));
  return {};
}

Error Checkpoint::other_frames(int frame) const {
  return bad_input(
      fmt::format("{}: of {} frames, and the input has others up to frame {}; allowed: the same "
                  "input, or to remove it",
                  path_.string(), passed_.end, frame));
}

Result<bool> Checkpoint::go_on(ViewStream& stream, const TrackCallbacks& callbacks, Tracker& tracker) {
  if (passed_.end == 0) return false;
  std::map<int, ViewPtr> views;
  for (int frame = 0; frame < passed_.end; ++frame) {
    if (callbacks.stopped()) return true;
    Result<ViewPtr> view = stream.next();
    if (!view) return view.error();
    if (!*view) return other_frames(frame);
    note(**view);
    if (passed_.needed.contains(frame)) views[frame] = *std::move(view);
  }
  if (sum_ != passed_sum_) return other_frames(passed_.end);
  const std::string state = std::exchange(state_, {});
  StateReader reader(state, views);
  if (!tracker.read_state(reader)) return internal_error(fmt::format("{}: no state", path_.string()));
  written_ = Clock::now();
  return false;
}

void Checkpoint::note(const View& view) {
  const double time = view.timestamp;
  sum_ = sum_of(sum_, {reinterpret_cast<const char*>(&time), sizeof time});
  sum_ = sum_of(sum_of(sum_, view.name), view.defect);
}

void Checkpoint::keep(Tracker& tracker, const EventSink& event) {
  if (path_.empty() || milliseconds_since(written_) < wait_ms_) return;
  const Clock::time_point start = Clock::now();
  StateWriter writer;
  tracker.write_state(writer);
  CheckpointContent content{identity_, tracker.frames(), sum_, {}, {}, writer.content()};
  for (const auto& [frame, detected] : writer.views()) {
    content.needed.push_back(frame);
    content.detected.push_back(detected);
  }
  const Result<void> written = write_file(path_, checkpoint_text(std::move(content)));
  if (!written) {
    tell(event, Event::Level::kWarning, fmt::format("no checkpoints: {}", written.error().message));
    path_.clear();
  }
  wait_ms_ = std::max(kLeastWaitMs, milliseconds_since(start) / kShareOfTime);
  written_ = Clock::now();
}

}  // namespace raysfm
