#pragma once

#include <string>
#include <vector>

#include "commands.h"
#include "raysfm/settings/config.h"

namespace raysfm::app {

// One flag for each setting but --seed and --threads, which belong to every subcommand.
void add_setting_flags(CLI::App& command, const std::vector<SettingField>& fields);

// Fills the settings that the command line left open from --config, where there is one, and sets `seed` and
// `threads` from the common flags. Likewise the inputs, of which there must be one, where they are asked for.
// Tells what came from the file.
Result<ConfigRecord> settle_settings(const std::vector<SettingField>& fields, const CLI::App& command,
                                     const CLI::App& program, const CommonOptions& common,
                                     std::vector<std::string>* inputs = nullptr);
// The same for a command of one input.
Result<ConfigRecord> settle_settings(const std::vector<SettingField>& fields, const CLI::App& command,
                                     const CLI::App& program, const CommonOptions& common,
                                     std::string* input);

// What names a file or a folder, which '' does not.
CLI::Validator named();

}  // namespace raysfm::app
