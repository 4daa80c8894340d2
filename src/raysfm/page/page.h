#pragma once

#include <filesystem>
#include <string>

#include "raysfm/core/result.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// Whether this build has the page: npm was there when it was made.
bool has_page();

// Writes one file of HTML that shows a result in any browser, without a network: paths, cameras, points,
// ellipsoids and numbers over frames. `title` may hold anything. Points beyond 60000 of a world are thinned
// evenly, and those far outside the scene left out; the page says so. Errors: bad input, where this build has
// no page or the file cannot be written.
Result<void> write_page(const Reconstruction& reconstruction, const std::string& title,
                        const std::filesystem::path& path);

}  // namespace raysfm
