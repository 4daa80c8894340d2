#include "raysfm/page/page.h"

#include <fmt/format.h>

#include <string_view>

#include "raysfm/files/atomic_file.h"
#include "raysfm/page/page_data.h"
#include "raysfm/page/page_template.h"

namespace raysfm {
namespace {

constexpr std::string_view kTitle = "<!--RAYSFM-TITLE-->", kData = "<!--RAYSFM-DATA-->";

std::string escaped(std::string_view text) {
  std::string html;
  for (const char c : text) {
    switch (c) {
      case '&':
        html += "&amp;";
        break;
      case '<':
        html += "&lt;";
        break;
      case '>':
        html += "&gt;";
        break;
      case '"':
        html += "&quot;";
        break;
      case '\'':
        html += "&#39;";
        break;
      default:
        html += c;
    }
  }
  return html;
}

}  // namespace

bool has_page() {
  return page_template().find(kData) != std::string_view::npos;
}

Result<void> write_page(const Reconstruction& reconstruction, const std::string& title,
                        const std::filesystem::path& path) {
  if (!has_page())
    return bad_input("this build has no page: npm was not there, or had no network, when it was made");
  const std::string_view page = page_template();
  const size_t title_at = page.find(kTitle), data_at = page.find(kData);
  std::string text(page.substr(0, title_at));
  text += escaped(title);
  text += page.substr(title_at + kTitle.size(), data_at - title_at - kTitle.size());
  text += page_data(reconstruction, title);
  text += page.substr(data_at + kData.size());
  return write_file(path, text);
}

}  // namespace raysfm
