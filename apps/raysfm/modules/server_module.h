#pragma once

#include "../page_server.h"

namespace raysfm::app {

// Loaded when something is served: the library of the server brings those of its encryption.
struct ServerModule {
  static constexpr const char* kFile = "raysfm-server.so";
  static constexpr const char* kSymbol = "raysfm_server_module";
  decltype(&app::start_page_server) start_page_server;
};

}  // namespace raysfm::app
