#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "raysfm/core/result.h"

namespace raysfm {

// A surface with its texture, as the page draws it.
struct PageMesh {
  int world = 0;                 // as in report.json
  std::vector<float> positions;  // x, y, z of each vertex, in the world frame
  std::vector<uint32_t> faces;   // three vertices each
  std::vector<uint16_t>
      places;        // of each corner of a face: from the lower left of the texture, 65535 is its end
  std::string jpeg;  // bytes of the texture's file
};

// Where `raysfm export RESULT --format mesh` writes unless told otherwise; empty where there is none.
std::filesystem::path mesh_folder_of(const std::filesystem::path& result);

// What `raysfm export --format mesh` wrote into a folder. Errors: bad input, naming the file, also where it
// is more than a page should carry, three megabytes.
Result<PageMesh> read_page_mesh(const std::filesystem::path& folder);

}  // namespace raysfm
