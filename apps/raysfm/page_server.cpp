#include "page_server.h"

#include <fmt/format.h>

#include <optional>

#include "raysfm/files/text_file.h"

namespace raysfm::app {

Result<ServerAddress> parse_server_address(const std::string& flag, const std::string& text) {
  ServerAddress address;
  const size_t colon = text.find_last_of(':');
  if (colon != std::string::npos) {
    address.host = text.substr(0, colon);
    if (address.host.size() > 2 && address.host.front() == '[' && address.host.back() == ']') {
      address.host = address.host.substr(1, address.host.size() - 2);
    }
  }
  const std::optional<int64_t> port = parse_integer(text.substr(colon == std::string::npos ? 0 : colon + 1));
  if (!port || *port < 1 || *port > 65535 || address.host.empty()) {
    return bad_input(
        fmt::format("{} = '{}': must be PORT or ADDRESS:PORT, a port from 1 to 65535", flag, text));
  }
  address.port = static_cast<int>(*port);
  return address;
}

}  // namespace raysfm::app
