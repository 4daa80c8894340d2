#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace raysfm::app {

// Text made of the tree of commands and options, so that it holds what the program knows.
std::string man_page(const CLI::App& program, const std::string& version);
std::string bash_completion(const CLI::App& program);
std::string zsh_completion(const CLI::App& program);

}  // namespace raysfm::app
