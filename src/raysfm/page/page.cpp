#include "raysfm/page/page.h"

#include <fmt/format.h>

#include <string_view>

#include "raysfm/files/atomic_file.h"
#include "raysfm/page/page_data.h"
#include "raysfm/page/page_template.h"

namespace raysfm {
namespace {

// In the order in which the page has them.
constexpr std::string_view kSources = "RAYSFM-SOURCES", kTitle = "<!--RAYSFM-TITLE-->",
                           kData = "<!--RAYSFM-DATA-->", kRest = "<!--RAYSFM-REST-->";

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

Result<std::string> page_html(const Reconstruction& reconstruction, const PageInfo& info, bool served) {
  if (!has_page())
    return bad_input("this build has no page: npm was not there, or had no network, when it was made");
  std::string_view rest = page_template();
  std::string text;
  const auto put = [&](std::string_view mark, std::string_view content) {
    const size_t at = rest.find(mark);
    text += rest.substr(0, at);
    text += content;
    rest.remove_prefix(at + mark.size());
  };
  put(kSources, served ? "connect-src 'self'; " : "");
  put(kTitle, escaped(info.title));
  const PageData data = page_data(reconstruction, info);
  put(kData, data.first);
  put(kRest, data.rest);
  text += rest;
  return text;
}

Result<void> write_page(const Reconstruction& reconstruction, const Report& report,
                        const std::filesystem::path& path) {
  const Result<std::string> html = page_html(reconstruction, page_info(report), false);
  if (!html) return html.error();
  return write_file(path, *html);
}

}  // namespace raysfm
