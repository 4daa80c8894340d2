#pragma once

#include <filesystem>
#include <string>

#include "raysfm/core/result.h"
#include "raysfm/page/page_info.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// Whether this build has the page: npm was there when it was made.
bool has_page();

// Text of one file of HTML that shows a result in any browser: paths, cameras, points, ellipsoids and numbers
// over frames. Points beyond 300000 of a world are thinned evenly, and those far outside the scene left out;
// the page says so. As a file it needs no network, and asks for none. `served`: it comes from a server, which
// it asks for what `info` says that there is. Errors: bad input, where this build has no page.
Result<std::string> page_html(const Reconstruction& reconstruction, const PageInfo& info, bool served);

// Writes page_html() of a finished result as a file; its title is what the result was made of. Errors: bad
// input, where this build has no page or the file cannot be written.
Result<void> write_page(const Reconstruction& reconstruction, const Report& report,
                        const std::filesystem::path& path);

}  // namespace raysfm
