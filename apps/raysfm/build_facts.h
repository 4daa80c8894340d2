#pragma once

#include <string>

namespace raysfm::app {

// The version on a line of its own, and how this program was built: compiler, instruction sets, parts.
std::string build_facts();

}  // namespace raysfm::app
