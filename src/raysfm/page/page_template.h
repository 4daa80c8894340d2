#pragma once

#include <string_view>

namespace raysfm {

// The page that write_page() fills in, as viewer/ makes it; empty where this build has none.
std::string_view page_template();

}  // namespace raysfm
