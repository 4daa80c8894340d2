#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <variant>
#include <vector>

#include "raysfm/core/result.h"

namespace raysfm {

// One setting under the name that the command line (--name) and YAML files (name:) share.
struct SettingField {
  std::string name;
  std::string help;
  std::variant<int*, double*, bool*, uint64_t*, std::string*> value;  // the default until it is set
  std::vector<std::string> allowed;                                   // of a string; empty: anything
};

// Bad input that names the first string among the fields that is not allowed.
Result<void> check_allowed(const std::vector<SettingField>& fields);

// Bad input for a number of threads that is none; 0 stands for as many as the machine has.
Result<void> check_threads(int threads);

// What config.yaml of an output folder holds beside the settings, and where these are.
struct ConfigRecord {
  std::string version;  // of the program that wrote it; empty: not said
  std::vector<std::string> inputs;
  std::string file;                  // empty: none was read
  std::map<std::string, int> lines;  // of the settings that were taken from the file
};

// Sets the fields that the YAML file names and `given` does not hold (what the command line said wins).
// Errors: bad input naming file, line, key, value and what is allowed.
Result<ConfigRecord> read_config(const std::filesystem::path& path, const std::vector<SettingField>& fields,
                                 const std::set<std::string>& given);

// An error that begins with the name of a setting, as the checks of values have it, in terms of the file
// where that setting came from it.
Error where_it_was_set(Error error, const ConfigRecord& record);

// Text of config.yaml: version, inputs and every setting as it was in effect. read_config() reads it back.
std::string effective_config(const std::vector<SettingField>& fields, const std::vector<std::string>& inputs,
                             const std::string& version);

}  // namespace raysfm
