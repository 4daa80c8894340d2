#pragma once

#include <functional>
#include <string>

namespace raysfm {

// What the library tells its caller while it works. The library itself never prints.
struct Event {
  enum class Level { kInfo, kWarning };
  Level level = Level::kInfo;
  std::string message;  // one line, without a full stop
};

// Whoever listens; empty: nobody.
using EventSink = std::function<void(const Event&)>;

// Where somebody listens and there is something to say.
inline void tell(const EventSink& event, Event::Level level, const std::string& message) {
  if (event && !message.empty()) event({level, message});
}

}  // namespace raysfm
