#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <csignal>
#include <deque>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <system_error>
#include <thread>
#include <utility>

#include "batch_cluster.h"
#include "batch_list.h"
#include "batch_pieces.h"
#include "batch_process.h"
#include "batch_record.h"
#include "commands.h"
#include "raysfm/core/timer.h"
#include "raysfm/files/atomic_file.h"
#include "raysfm/files/file_lock.h"
#include "raysfm/files/text_file.h"
#include "setting_flags.h"
#include "terminal.h"

namespace raysfm::app {
namespace {

namespace fs = std::filesystem;

struct BatchArguments {
  std::string list, out, part, slurm, dask;
  int jobs = 0;  // at a time; 0: as many as the machine has cores for
  bool summary = false;
};

// Which jobs are done here: first, first + step, ...
struct Part {
  size_t first = 0, step = 1;
};

Result<Part> parse_part(const std::string& text) {
  if (text.empty()) return Part{};
  const size_t slash = std::min(text.find('/'), text.size());
  const auto number = parse_integer(std::string_view(text).substr(0, slash));
  const auto count = parse_integer(std::string_view(text).substr(std::min(slash + 1, text.size())));
  if (number && count && *number >= 1 && *number <= *count) {
    return Part{static_cast<size_t>(*number - 1), static_cast<size_t>(*count)};
  }
  return bad_input(fmt::format("--part = '{}': must be NUMBER/COUNT, e.g. 1/4", shown(text)));
}

// Why a run has no result, from its log: the error that it tells, which a summary of what there is may
// follow; else the last line.
std::string reason_in(const fs::path& log, const std::string& command) {
  constexpr uintmax_t kMaxLogBytes = 64 << 20;
  const Result<std::string> read = read_text_file(log, kMaxLogBytes);
  if (!read) return read.error().message;
  const std::string text = fmt::format("\n{}", trimmed(*read));
  for (const std::string& begin : {fmt::format("\nraysfm {}: ", command), std::string("\nraysfm: ")}) {
    const size_t at = text.rfind(begin);
    if (at == std::string::npos) continue;
    const std::string error = text.substr(at + begin.size());
    return error.substr(0, error.find('\n'));
  }
  return text.substr(text.rfind('\n') + 1);
}

// Runs jobs, so many at a time, until all are done or somebody wants them to end.
class BatchRunner {
 public:
  BatchRunner(const BatchFolder& folder, const fs::path& list, int threads, ProgressLine* progress,
              const StopSignals& stop)
      : folder_(folder), list_(list), threads_(threads), progress_(progress), stop_(stop) {}

  Result<void> run(const std::vector<const BatchJob*>& jobs, size_t at_a_time) {
    total_ = jobs.size();
    done_ = 0;
    std::deque<const BatchJob*> open(jobs.begin(), jobs.end());
    Clock::time_point last_run = Clock::now();
    for (;;) {
      for (size_t tries = open.size(); tries > 0 && !stopped() && running_.size() < at_a_time; --tries) {
        const BatchJob& job = *open.front();
        open.pop_front();
        const bool last_try = milliseconds_since(last_run) > kHeld;
        const Result<bool> begun = begin(job, last_try);
        if (!begun) return ended_by(begun.error());
        if (!*begun) open.push_back(&job);
      }
      if (running_.empty() && (open.empty() || stopped())) return {};
      if (!running_.empty()) last_run = Clock::now();
      if (stopped() && !std::exchange(told_, true)) tell_all(SIGTERM);  // again would end them at once
      const ChildEnd end = next_child_end(kPause);
      if (end.process < 0) continue;
      if (auto r = finish(end); !r) return ended_by(r.error());
    }
  }

 private:
  struct Running {
    const BatchJob* job;
    FileLock lock;
    Clock::time_point start;
  };
  static constexpr int kPause = 200;     // milliseconds
  static constexpr double kHeld = 30e3;  // for what a batch that was killed has left running

  bool stopped() const { return stop_.requested()->load(); }

  // False where it is to be tried again: another run holds it.
  Result<bool> begin(const BatchJob& job, bool last_try) {
    if (!job.fault.empty()) {
      progress_->line(fmt::format("{}: {} ({} of {})", job.name, job.fault, ++done_, total_));
      return true;
    }
    Result<FileLock> lock = FileLock::take(folder_.record(job));
    if (!lock && !last_try) return false;
    if (!lock) {
      progress_->line(fmt::format("{}: left out: {}", job.name, lock.error().message));
      ++done_;
      return true;
    }
    if (is_finished(read_record(folder_, job), folder_, job)) {
      ++done_;
      progress_->line(fmt::format("{}: has a result already ({} of {})", job.name, done_, total_));
      return true;
    }
    std::vector<std::string> arguments = job.arguments;
    const std::string more[] = {"--out", folder_.result(job).string(), "--threads", std::to_string(threads_)};
    arguments.insert(arguments.end(), std::begin(more), std::end(more));
    std::error_code ignored;
    fs::remove(folder_.record(job), ignored);
    if (!job.whole.empty()) fs::remove(folder_.record({.name = job.whole}), ignored);
    const Result<pid_t> child = ChildProcess::start(arguments, list_.parent_path(), folder_.log(job), *lock);
    if (!child) return child.error();
    running_.emplace(*child, Running{&job, *std::move(lock), Clock::now()});
    return true;
  }

  Result<void> finish(const ChildEnd& end) {
    const auto found = running_.find(end.process);
    if (found == running_.end()) return {};
    const BatchJob& job = *found->second.job;
    BatchRecord record{job.arguments, RAYSFM_VERSION, end.exit_code, "",
                       milliseconds_since(found->second.start) / 1000};
    if (stopped() && end.exit_code != 0) {
      running_.erase(found);
      return {};  // half done: done anew the next time
    }
    std::error_code failure;
    if (!end.signal.empty()) {
      record.reason = fmt::format("ended by a signal: {}", end.signal);
    } else if (end.exit_code != 0) {
      record.reason = reason_in(folder_.log(job), job.arguments.front());
      if (record.reason.empty()) record.reason = fmt::format("ended with exit code {}", end.exit_code);
    } else if (!fs::exists(folder_.result(job) / "report.json", failure)) {
      record.exit_code = 1;
      record.reason = "left no result";
    }
    const Result<void> written = write_record(record, folder_, job);
    running_.erase(found);
    ++done_;
    progress_->line(fmt::format("{}: {}, {:.1f} s ({} of {})", job.name,
                                record.reason.empty() ? "done" : record.reason, record.seconds, done_,
                                total_));
    return written;
  }

  void tell_all(int signal) {
    for (const auto& [process, running] : running_) kill(process, signal);
  }

  // Whatever is wrong, nothing is left running.
  Result<void> ended_by(Error error) {
    tell_all(SIGTERM);
    while (!running_.empty()) {
      if (const ChildEnd end = next_child_end(kPause); end.process >= 0) running_.erase(end.process);
    }
    return error;
  }

  const BatchFolder& folder_;
  fs::path list_;
  int threads_;
  ProgressLine* progress_;
  const StopSignals& stop_;
  std::map<pid_t, Running> running_;
  size_t done_ = 0, total_ = 0;
  bool told_ = false;  // to end
};

Result<fs::path> absolute(const std::string& path) {
  std::error_code failure;
  fs::path whole = fs::absolute(path, failure).lexically_normal();
  if (failure) return bad_input(fmt::format("{}: {}", path, failure.message()));
  if (whole.filename().empty()) whole = whole.parent_path();
  return whole;
}

Result<int> write_scripts(const BatchArguments& arguments, const CommonOptions& common,
                          const ClusterBatch& batch) {
  const std::string inputs[] = {arguments.list};
  const std::pair<std::string, std::string> scripts[] = {{arguments.slurm, slurm_script(batch)},
                                                         {arguments.dask, dask_script(batch)}};
  for (const auto& [path, text] : scripts) {
    if (path.empty()) continue;
    if (auto r = check_not_input("--slurm, --dask", path, inputs); !r) return r.error();
    if (auto r = write_file(path, text); !r) return r.error();
    if (!common.quiet) std::printf("written to %s: %d videos\n", path.c_str(), batch.jobs);
  }
  return 0;
}

// The table on the disk and on the terminal; the exit code.
Result<int> tell_table(const std::vector<BatchJob>& jobs, const BatchFolder& folder,
                       const CommonOptions& common) {
  const BatchTable table = batch_table(jobs, folder);
  if (auto r = write_file(folder.table(), table.csv); !r) return r.error();
  if (common.quiet) return table.exit_code;
  std::string text = table.text;
  if (table.without_result > 0) {
    text += fmt::format("{} of {} videos have no result\n", table.without_result, jobs.size());
  }
  if (const Result<int> said = printed(text + "table: " + folder.table().string() + "\n"); !said) return said;
  return table.exit_code;
}

// Joins whose pieces are all there.
std::vector<const BatchJob*> joins_at_hand(const BatchPlan& plan, const BatchFolder& folder) {
  std::vector<const BatchJob*> at_hand;
  for (const BatchJob& join : plan.joins) {
    const bool ready = std::ranges::all_of(plan.jobs, [&](const BatchJob& job) {
      return job.whole != join.name || is_finished(read_record(folder, job), folder, job);
    });
    if (ready) at_hand.push_back(&join);
  }
  return at_hand;
}

// The jobs of a part, and the joins where that is all.
Result<int> run_jobs(const BatchArguments& arguments, const CommonOptions& common, const BatchPlan& plan,
                     const BatchFolder& folder, const fs::path& list) {
  const Result<Part> part = parse_part(arguments.part);
  if (!part) return part.error();
  std::vector<BatchJob> own_jobs;
  if (!arguments.summary) {
    for (size_t i = part->first; i < plan.jobs.size(); i += part->step) own_jobs.push_back(plan.jobs[i]);
  }
  std::vector<const BatchJob*> own;
  for (const BatchJob& job : own_jobs) own.push_back(&job);
  if (auto r = create_folder(folder.records()); !r) return r.error();
  const int threads = std::max(1, common.threads);
  const int cores = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  const int at_a_time = arguments.jobs > 0 ? arguments.jobs : std::max(1, cores / threads);
  const StopSignals stop;
  ProgressLine progress(common.quiet);
  BatchRunner runner(folder, list, threads, &progress, stop);
  if (auto r = runner.run(own, static_cast<size_t>(at_a_time)); !r) return r.error();
  if (arguments.part.empty() && !stop.requested()->load()) {
    const std::vector<const BatchJob*> joins = joins_at_hand(plan, folder);
    if (auto r = runner.run(joins, static_cast<size_t>(at_a_time)); !r) return r.error();
  }
  if (stop.requested()->load()) {
    progress.line("interrupted; the same command goes on");
    return stop.exit_code();
  }
  if (!arguments.part.empty()) return batch_table(own_jobs, folder).exit_code;
  return tell_table(plan.all(), folder, common);
}

Result<int> run_batch(const BatchArguments& arguments, const CommonOptions& common) {
  if (!common.config.empty()) return bad_input("--config is not allowed here, lines of the list may have it");
  const Result<std::vector<BatchJob>> jobs = read_batch_list(arguments.list);
  if (!jobs) return jobs.error();
  const Result<fs::path> list = absolute(arguments.list), out = absolute(arguments.out);
  if (!list) return list.error();
  if (!out) return out.error();
  const BatchFolder folder{*out};
  Result<BatchPlan> plan = plan_batch(*jobs, list->parent_path(), folder);
  if (!plan) return bad_input(fmt::format("{}: {}", arguments.list, plan.error().message));
  if (!arguments.slurm.empty() || !arguments.dask.empty()) {
    std::error_code failure;
    const fs::path program = fs::read_symlink("/proc/self/exe", failure);
    return write_scripts(arguments, common, {program, *list, *out, static_cast<int>(plan->jobs.size())});
  }
  return run_jobs(arguments, common, *plan, folder, *list);
}

}  // namespace

Command add_batch(CLI::App& program, const CommonOptions& common) {
  auto arguments = std::make_shared<BatchArguments>();
  CLI::App* command =
      program.add_subcommand("batch", "many videos over the cores of a machine, or of a cluster");
  command->footer(
      "A line of LIST is [track|solve] INPUT... [FLAGS] [--name NAME] [--pieces N] [--overlap SECONDS]; "
      "names are "
      "those seen from its folder, quoted where they hold spaces. Started again, finished videos are left "
      "alone.");
  command->add_option("LIST", arguments->list, "file with one line for each video")
      ->required()
      ->check(named());
  command->add_option("--out", arguments->out, "folder for a folder of results for each video")
      ->required()
      ->check(named());
  command
      ->add_option("--jobs", arguments->jobs,
                   "videos at a time; 0 for as many as there are cores for, of --threads each")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  command->add_option("--part", arguments->part, "only videos K, K + N, ... of the list")->type_name("K/N");
  command->add_flag("--summary", arguments->summary, "only joins pieces that are finished, and the table");
  command->add_option("--slurm", arguments->slurm, "only write a job array for Slurm's sbatch")
      ->type_name("FILE");
  command->add_option("--dask", arguments->dask, "only write a script for dask.distributed")
      ->type_name("FILE");
  return [arguments, &common] { return run_batch(*arguments, common); };
}

}  // namespace raysfm::app
