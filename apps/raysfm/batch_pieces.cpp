#include "batch_pieces.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <string_view>
#include <utility>

#include "raysfm/files/text_file.h"
#include "raysfm/frames/frame_source.h"

namespace raysfm::app {
namespace {

// What a piece is told by its plan, or what it cannot be joined with.
constexpr std::string_view kOfWholes[] = {"--from", "--to", "--save-map", "--map", "--localise", "--config"};

std::string flag_of(const std::string& word) {
  return word.substr(0, word.find('='));
}

Result<void> check_can_be_cut(const BatchJob& job) {
  if (job.arguments[0] != "track") return bad_input("--pieces: only of videos of track");
  for (const std::string& word : job.arguments) {
    if (std::ranges::find(kOfWholes, flag_of(word)) == std::end(kOfWholes)) continue;
    return bad_input(fmt::format("{} is not allowed beside --pieces", flag_of(word)));
  }
  return {};
}

// The times of the frames of the first input.
Result<TimeRange> span_of(const BatchJob& job, const std::filesystem::path& folder) {
  std::vector<std::string> inputs;
  for (size_t i = 1; i < job.arguments.size() && !job.arguments[i].starts_with('-'); ++i) {
    inputs.push_back((folder / job.arguments[i]).string());
  }
  InputOptions options{.ignore_calibration = true, .threads = 1};
  for (size_t i = 1; i < job.arguments.size(); ++i) {
    const std::string& word = job.arguments[i];
    if (flag_of(word) == "--mono") options.mono = true;
    if (flag_of(word) != "--fps") continue;
    const bool is_apart = word == "--fps" && i + 1 < job.arguments.size();
    options.fps = parse_number(is_apart ? job.arguments[i + 1] : word.substr(word.find('=') + 1)).value_or(0);
  }
  const Result<Input> input = open_input(inputs, options);
  if (!input) return input.error();
  const TimeRange span = input->streams[0]->span();
  if (span.to > span.from) return span;
  return bad_input(fmt::format("{}: its length is not known, which --pieces needs", inputs[0]));
}

// The job of one piece, which does not say yet where it begins and ends.
BatchJob piece_of(const BatchJob& job, int number) {
  BatchJob piece = job;
  piece.pieces = 1;
  piece.whole = job.name;
  piece.name = fmt::format("{}.piece-{}", job.name, number);
  return piece;
}

void add_cut(std::vector<BatchJob> pieces, const BatchJob& job, const BatchFolder& folder, BatchPlan* plan) {
  BatchJob join{job.line, job.name, {"join"}};
  for (BatchJob& piece : pieces) {
    join.arguments.push_back(folder.result(piece).string());
    plan->jobs.push_back(std::move(piece));
  }
  plan->joins.push_back(std::move(join));
}

Result<void> cut(const BatchJob& job, const TimeRange& span, const BatchFolder& folder, BatchPlan* plan) {
  const double length = (span.to - span.from) / job.pieces;
  if (!(length > job.overlap)) {
    return bad_input(
        fmt::format("--pieces = {}: pieces of {:.3g} s are not longer than their --overlap, {:g} s",
                    job.pieces, length, job.overlap));
  }
  std::vector<BatchJob> pieces;
  for (int p = 0; p < job.pieces; ++p) {
    BatchJob& piece = pieces.emplace_back(piece_of(job, p + 1));
    const auto add = [&](const char* flag, double time) {
      piece.arguments.insert(piece.arguments.end(), {flag, fmt::format("{:.6f}", time)});
    };
    if (p > 0) add("--from", span.from + p * length - job.overlap / 2);
    if (p + 1 < job.pieces) add("--to", span.from + (p + 1) * length + job.overlap / 2);
    piece.arguments.insert(piece.arguments.end(),
                           {"--save-map", (folder.result(piece) / "map.raysfm").string()});
  }
  add_cut(std::move(pieces), job, folder, plan);
  return {};
}

// The time behind a flag, which the arguments of a piece have once at most.
std::optional<double> time_of(const BatchJob& piece, std::string_view flag) {
  const auto found = std::ranges::find(piece.arguments, flag);
  if (found == piece.arguments.end() || found + 1 == piece.arguments.end()) return std::nullopt;
  return parse_number(*(found + 1));
}

bool starts_with(const std::vector<std::string>& words, const std::vector<std::string>& first) {
  return std::ranges::mismatch(first, words).in1 == first.end();
}

// As an earlier run cut the same line; false where not all of its pieces have been run.
bool cut_as_before(const BatchJob& job, const BatchFolder& folder, BatchPlan* plan) {
  std::vector<BatchJob> pieces;
  for (int p = 0; p < job.pieces; ++p) {
    const bool is_first = p == 0, is_last = p + 1 == job.pieces;
    BatchJob piece = piece_of(job, p + 1);
    std::optional<BatchRecord> record = read_record(folder, piece);
    if (!record || !starts_with(record->arguments, job.arguments)) return false;
    piece.arguments = std::move(record->arguments);
    const size_t added = 2 + (is_first ? 0 : 2) + (is_last ? 0 : 2);  // flags and their values
    const std::optional<double> from = time_of(piece, "--from"), to = time_of(piece, "--to");
    if (piece.arguments.size() != job.arguments.size() + added) return false;
    if (from.has_value() == is_first || to.has_value() == is_last) return false;
    constexpr double kRounding = 2e-6;
    if (from && std::abs(*time_of(pieces.back(), "--to") - *from - job.overlap) > kRounding) return false;
    pieces.push_back(std::move(piece));
  }
  add_cut(std::move(pieces), job, folder, plan);
  return true;
}

}  // namespace

std::vector<BatchJob> BatchPlan::all() const {
  std::vector<BatchJob> all = jobs;
  all.insert(all.end(), joins.begin(), joins.end());
  std::ranges::stable_sort(all, {}, &BatchJob::line);
  return all;
}

Result<BatchPlan> plan_batch(const std::vector<BatchJob>& lines, const std::filesystem::path& inputs,
                             const BatchFolder& folder) {
  BatchPlan plan;
  for (const BatchJob& job : lines) {
    if (job.pieces == 1) {
      plan.jobs.push_back(job);
      continue;
    }
    const auto refused = [&](const Error& why) {
      return bad_input(fmt::format("line {}: {}", job.line, why.message));
    };
    if (auto r = check_can_be_cut(job); !r) return refused(r.error());
    const Result<TimeRange> span = span_of(job, inputs);
    if (!span && cut_as_before(job, folder, &plan)) continue;
    const Result<void> made = span ? cut(job, *span, folder, &plan) : span.error();
    if (!made) plan.jobs.emplace_back(job).fault = made.error().message;
  }
  std::set<std::string> names;
  for (const BatchJob& job : plan.all()) {
    if (names.insert(job.name).second) continue;
    return bad_input(
        fmt::format("line {}: its result would be '{}', as that of another; --name NAME gives it another",
                    job.line, shown(job.name)));
  }
  return plan;
}

}  // namespace raysfm::app
