#include "batch_list.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <string_view>

#include "raysfm/files/text_file.h"

namespace raysfm::app {
namespace {

constexpr uintmax_t kMaxListBytes = 64 << 20;
constexpr size_t kMaxName = 200;  // bytes

// Flags that belong to the whole, or that leave no result.
constexpr std::string_view kNotOfAJob[] = {"--out", "--quiet", "--threads", "--help", "-h", "--version"};

// "video" of "films/video.mp4", "frames" of "frames/".
std::string name_of_input(const std::string& input) {
  std::filesystem::path path = std::filesystem::path(input).lexically_normal();
  if (path.filename().empty()) path = path.parent_path();
  const std::string name = path.stem().string();
  return name.empty() ? "video" : name;
}

Result<void> check_name(const std::string& name) {
  const bool plain =
      std::ranges::none_of(name, [](char c) { return c == '/' || (c >= 0 && c < ' ') || c == 127; });
  if (plain && !name.empty() && name.size() <= kMaxName && name[0] != '.' && name != "batch") return {};
  return bad_input(
      fmt::format("--name = '{}': must be the name of a folder, of at most {} bytes, that does not "
                  "begin with a dot, and not 'batch'",
                  shown(name), kMaxName));
}

// Takes a flag and its value out of the words; the last where there are several, and empty where there is
// none.
Result<std::string> taken(const std::string& flag, std::vector<std::string>* words) {
  std::string value;
  for (auto word = words->begin(); word != words->end();) {
    if (word->starts_with(flag + "=")) {
      value = word->substr(flag.size() + 1);
      word = words->erase(word);
    } else if (*word == flag) {
      if (word + 1 == words->end()) return bad_input(flag + ": a value is missing behind it");
      value = *(word + 1);
      word = words->erase(word, word + 2);
    } else {
      ++word;
      continue;
    }
    if (value.empty()) return bad_input(flag + ": must not be empty");
  }
  return value;
}

Result<void> take_pieces(std::vector<std::string>* words, BatchJob* job) {
  constexpr int kMostPieces = 10000;
  constexpr double kMostOverlap = 3600;
  const Result<std::string> pieces = taken("--pieces", words), overlap = taken("--overlap", words);
  if (!pieces) return pieces.error();
  if (!overlap) return overlap.error();
  if (!pieces->empty()) {
    const auto count = parse_integer(*pieces);
    if (!count || *count < 1 || *count > kMostPieces) {
      return bad_input(fmt::format("--pieces = '{}': must be 1 to {}", shown(*pieces), kMostPieces));
    }
    job->pieces = static_cast<int>(*count);
  }
  if (overlap->empty()) return {};
  const auto seconds = parse_number(*overlap);
  if (!seconds || !(*seconds > 0 && *seconds <= kMostOverlap)) {
    return bad_input(fmt::format("--overlap = '{}': must be seconds, more than 0 and at most {}",
                                 shown(*overlap), kMostOverlap));
  }
  job->overlap = *seconds;
  return {};
}

Result<BatchJob> job_of(std::string_view line) {
  Result<std::vector<std::string>> words = shell_words(line);
  if (!words) return words.error();
  BatchJob job;
  Result<std::string> name = taken("--name", &*words);
  if (!name) return name.error();
  if (auto r = take_pieces(&*words, &job); !r) return r.error();
  job.arguments = *std::move(words);
  if (job.arguments.empty() || (job.arguments[0] != "track" && job.arguments[0] != "solve")) {
    job.arguments.insert(job.arguments.begin(), "track");
  }
  if (job.arguments.size() < 2 || job.arguments[1].empty() || job.arguments[1][0] == '-') {
    return bad_input("must begin with a video, images or a sequence; flags go behind it");
  }
  for (const std::string& word : job.arguments) {
    const std::string_view flag = std::string_view(word).substr(0, word.find('='));
    if (std::ranges::find(kNotOfAJob, flag) == std::end(kNotOfAJob)) continue;
    return bad_input(fmt::format("{} is not allowed here", flag));
  }
  job.name = name->empty() ? name_of_input(job.arguments[1]) : *name;
  if (auto r = check_name(job.name); !r) return r.error();
  return job;
}

}  // namespace

Result<std::vector<std::string>> shell_words(std::string_view line) {
  std::vector<std::string> words;
  bool in_word = false;
  char quote = 0;
  for (size_t i = 0; i < line.size(); ++i) {
    const char c = line[i];
    const bool escapes = c == '\\' && quote != '\'' && i + 1 < line.size() &&
                         (quote == 0 || line[i + 1] == '"' || line[i + 1] == '\\');
    if (quote == 0 && (c == ' ' || c == '\t' || c == '\r')) {
      in_word = false;
      continue;
    }
    if (quote == 0 && c == '#' && !in_word) break;
    if (!in_word) words.emplace_back();
    in_word = true;
    if (escapes) {
      words.back() += line[++i];
    } else if (quote == 0 && (c == '\'' || c == '"')) {
      quote = c;
    } else if (c == quote) {
      quote = 0;
    } else {
      words.back() += c;
    }
  }
  if (quote != 0) return bad_input(fmt::format("a {} is not closed", quote));
  return words;
}

std::string shell_quoted(const std::string& text) {
  std::string quoted = "'";
  for (const char c : text) quoted += c == '\'' ? "'\\''" : std::string(1, c);
  return quoted + "'";
}

Result<std::vector<BatchJob>> read_batch_list(const std::filesystem::path& path) {
  const Result<std::string> text = read_text_file(path, kMaxListBytes);
  if (!text) return text.error();
  std::vector<BatchJob> jobs;
  std::map<std::string, int> line_of;  // by name
  for (const TextLine& line : content_lines(*text)) {
    const auto refused = [&](const std::string& why) {
      return bad_input(fmt::format("{}: line {}: {}", path.string(), line.number, why));
    };
    if (line.text.find('\0') != std::string_view::npos) return refused("must be text");
    Result<BatchJob> job = job_of(line.text);
    if (!job) return refused(job.error().message);
    job->line = line.number;
    const auto [other, is_new] = line_of.emplace(job->name, line.number);
    if (!is_new) {
      return refused(fmt::format("its result would be '{}' as that of line {}; --name NAME gives it another",
                                 shown(job->name), other->second));
    }
    jobs.push_back(*std::move(job));
  }
  if (jobs.empty())
    return bad_input(fmt::format("{}: no videos; one line for each is needed", path.string()));
  return jobs;
}

}  // namespace raysfm::app
