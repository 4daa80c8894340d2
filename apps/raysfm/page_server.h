#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <string>

#include "raysfm/core/result.h"

namespace raysfm::app {

// Where a page is served.
struct ServerAddress {
  std::string host = "127.0.0.1";
  int port = 8765;
};

// PORT or ADDRESS:PORT. Errors: bad input, with `flag`.
Result<ServerAddress> parse_server_address(const std::string& flag, const std::string& text);

// One who listens to events.
struct Listener {
  bool new_here = true;
  size_t heard = 0;  // whatever the answers make of it
};

// An answer, and what is to be done when the browser has it, or has gone.
struct DataAnswer {
  std::string text;
  std::function<void()> sent;
};

// What a server answers with, asked on its own threads. An empty function: there is no such thing.
struct PageAnswers {
  std::function<Result<std::string>()> page;                          // HTML
  std::function<DataAnswer()> data;                                   // two lines of JSON
  std::function<Result<std::string>(int frame, int camera)> picture;  // JPEG
  std::function<std::string(int frame, int camera)> features;         // JSON
  // The text of the next event, waiting for it up to a second: empty where there is none yet. False: it was
  // the last.
  std::function<bool(Listener* listener, std::string* event)> next_event;
  std::function<void(int change)> listeners;  // one more, or one less
};

// Serves until it is destroyed, which lasts as long as an answer under way.
class PageServer {
 public:
  virtual ~PageServer() = default;
  // To open in a browser.
  virtual std::string url() const = 0;
};

// Serves a page and what it asks for, and nothing else: no file of the machine has an address. Errors: bad
// input, where the address is not to be had.
Result<std::unique_ptr<PageServer>> start_page_server(const ServerAddress& address, PageAnswers answers);

}  // namespace raysfm::app
