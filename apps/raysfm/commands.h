#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <functional>
#include <string>

#include "raysfm/core/result.h"

namespace raysfm::app {

// Flags that every subcommand knows.
struct CommonOptions {
  bool quiet = false;
  int threads = 0;  // 0: as many as the machine has
  uint64_t seed = 0;
  std::string config;  // path of a YAML file, empty: none
};

// What a subcommand does once its flags are parsed. The returned number is the exit code.
using Command = std::function<Result<int>()>;

// Each adds one subcommand with its flags to `program` and returns what runs when it is chosen.
Command add_track(CLI::App& program, const CommonOptions& common);
Command add_adjust(CLI::App& program, const CommonOptions& common);
Command add_solve(CLI::App& program, const CommonOptions& common);
Command add_eval(CLI::App& program, const CommonOptions& common);
Command add_synth(CLI::App& program, const CommonOptions& common);
Command add_export(CLI::App& program, const CommonOptions& common);
Command add_view(CLI::App& program, const CommonOptions& common);
Command add_camera(CLI::App& program, const CommonOptions& common);
Command add_batch(CLI::App& program, const CommonOptions& common);
Command add_join(CLI::App& program, const CommonOptions& common);
Command add_map(CLI::App& program, const CommonOptions& common);

// A subcommand of `camera`, which is given in place of the program.
Command add_calibrate(CLI::App& camera, const CommonOptions& common);

}  // namespace raysfm::app
