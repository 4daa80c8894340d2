#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "raysfm/core/result.h"

namespace raysfm {

// A parsed YAML, JSON or XML document: scalars, lists and maps.
struct ConfigNode {
  enum class Kind { kNull, kScalar, kList, kMap };
  Kind kind = Kind::kNull;
  int line = 0;                   // of the document, from 1, where YAML's reader made it; else 0
  std::string text;               // of a scalar
  std::vector<std::string> keys;  // of a map, as long as items, each once
  std::vector<ConfigNode> items;  // of a list or map

  const ConfigNode* find(std::string_view key) const;
};

// Limits of a document: deeper or larger ones are refused. Aliases count as what they stand for.
constexpr int kMaxConfigDepth = 32;
constexpr int kMaxConfigNodes = 1 << 20;

// Parses YAML, hence also JSON. The header "%YAML:1.0" that OpenCV writes is accepted. Tags are ignored.
// Errors: one line that begins with `name`.
Result<ConfigNode> parse_yaml(std::string_view text, const std::string& name);

// Parses the XML that OpenCV's FileStorage writes: elements and text. An element with child elements becomes
// a map, or a list if they are all named "_"; an element without is a scalar. Attributes are ignored;
// entities other than the five predefined ones, and document types, are refused.
Result<ConfigNode> parse_xml(std::string_view text, const std::string& name);

}  // namespace raysfm
