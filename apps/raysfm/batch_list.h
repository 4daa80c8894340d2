#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "raysfm/core/result.h"

namespace raysfm::app {

// A line of a list of videos: a run of its own.
struct BatchJob {
  int line = 0;                             // of the list
  std::string name = {};                    // of its folder among the results; no two are alike
  std::vector<std::string> arguments = {};  // of the program, without --out: command, inputs, flags
  int pieces = 1;                           // that the video is cut into
  double overlap = 10;                      // of them, seconds
  std::string whole = {};  // name of the job that joins this piece to the others; empty: no piece
  std::string fault = {};  // why it is left out; empty: it is not
};

// The jobs of a list, in its order: a line is [track|solve] INPUT... [FLAGS] [--name NAME] [--pieces N]
// [--overlap SECONDS], in words as a shell's, quoted by ' or " where they hold spaces; # begins a comment. A
// job is named after its first input where nothing else is said. Errors: bad input with file and line.
Result<std::vector<BatchJob>> read_batch_list(const std::filesystem::path& path);

// The words of a line. Errors: bad input, a quote that does not end.
Result<std::vector<std::string>> shell_words(std::string_view line);

// One word that a shell reads as `text`.
std::string shell_quoted(const std::string& text);

}  // namespace raysfm::app
