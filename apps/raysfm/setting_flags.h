#pragma once

#include <string>
#include <vector>

#include "commands.h"
#include "raysfm/api/config.h"

namespace raysfm::app {

// One flag for each setting but --seed and --threads, which belong to every subcommand.
void add_setting_flags(CLI::App& command, const std::vector<SettingField>& fields);

// Fills the settings that the command line left open from --config, where there is one, and sets `seed` and
// `threads` from the common flags.
Result<void> settle_settings(const std::vector<SettingField>& fields, const CLI::App& command,
                             const CLI::App& program, const CommonOptions& common);

}  // namespace raysfm::app
