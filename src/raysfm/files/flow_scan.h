#pragma once

#include <string>
#include <string_view>

namespace raysfm {

// Whether the flow collections of a YAML document, hence all of a JSON one, hold to the limits of
// config_tree.h: looked at before a parser does, which reads a flow collection to its end before it tells of
// its beginning, and takes a hundred bytes for each bracket. Empty, or "line N: " and what is not allowed.
// Knows quotes and comments; a document that is no YAML may pass.
std::string flow_excess(std::string_view document);

}  // namespace raysfm
