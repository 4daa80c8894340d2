#include "server_module.h"

#include <httplib.h>
#include <pthread.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <optional>
#include <thread>
#include <utility>

#include "raysfm/files/text_file.h"

namespace raysfm::app {
namespace {

constexpr int kMostListeners = 8, kThreads = 14;
constexpr int kWriteSeconds = 5;  // a browser that takes nothing for so long has gone

// As long as it lives, threads that are started hear no signals: a browser that went away is no closed pipe
// of the program, and who presses Ctrl-C means the run.
class WithoutSignals {
 public:
  WithoutSignals() {
    sigset_t all;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before_);
  }
  ~WithoutSignals() { pthread_sigmask(SIG_SETMASK, &before_, nullptr); }
  WithoutSignals(const WithoutSignals&) = delete;
  WithoutSignals& operator=(const WithoutSignals&) = delete;

 private:
  sigset_t before_ = {};
};

// Puts back what the library's server sets for the whole program.
class KeptPipeSignal {
 public:
  KeptPipeSignal() { sigaction(SIGPIPE, nullptr, &before_); }
  void restore() const { sigaction(SIGPIPE, &before_, nullptr); }

 private:
  struct sigaction before_ = {};
};

// The server works when nobody else wants to.
void step_back() {
  thread_local const bool done = setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), 10) == 0;
  static_cast<void>(done);
}

// Not those of the library, which let two programs have one port.
void set_options(socket_t socket) {
  const int yes = 1;
  setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
}

void refuse(httplib::Response& response, int status, const std::string& why) {
  response.status = status;
  response.set_content(why + "\n", "text/plain");
}

// As it is: to compress what does not leave the machine takes longer than to send it.
// `sent` is called in the end.
void answer(
    httplib::Response& response, std::string content, const char* type,
    const std::function<void()>& sent = [] {}) {
  const auto kept = std::make_shared<const std::string>(std::move(content));
  const auto send = [kept](size_t offset, size_t length, httplib::DataSink& sink) {
    return sink.write(kept->data() + offset, length);
  };
  response.set_content_provider(kept->size(), type, send, [sent](bool) { sent(); });
}

// A number of the query, nullopt where there is none.
std::optional<int> number_in(const httplib::Request& request, const char* name) {
  const std::optional<int64_t> number = parse_integer(request.get_param_value(name));
  if (!number || *number < 0 || *number > 1'000'000'000) return std::nullopt;
  return static_cast<int>(*number);
}

class HttpServer : public PageServer {
 public:
  HttpServer(ServerAddress address, PageAnswers answers)
      : address_(std::move(address)), answers_(std::move(answers)) {
    pipe_signal_.restore();
    server_.new_task_queue = [] { return new httplib::ThreadPool(kThreads); };
    server_.set_socket_options(set_options);
    server_.set_keep_alive_max_count(1);
    server_.set_write_timeout(kWriteSeconds);
    server_.set_read_timeout(kWriteSeconds);
    server_.set_payload_max_length(0);
    server_.set_tcp_nodelay(true);
    server_.set_default_headers({{"Cache-Control", "no-store"}, {"X-Content-Type-Options", "nosniff"}});
    server_.set_pre_routing_handler([this](const httplib::Request& request, httplib::Response& response) {
      return check(request, response);
    });
    add_answers();
    add_frame_answers();
    if (answers_.next_event) {
      server_.Get("/events", [this](const httplib::Request&, httplib::Response& r) { stream_events(r); });
    }
  }

  ~HttpServer() override {
    ending_ = true;
    server_.stop();
    if (thread_.joinable()) thread_.join();
  }

  Result<void> start() {
    errno = 0;
    if (!server_.bind_to_port(address_.host, address_.port)) return why_not(errno);
    const WithoutSignals quiet;
    thread_ = std::thread([this] { server_.listen_after_bind(); });
    while (!server_.is_running()) std::this_thread::yield();
    return {};
  }

  std::string url() const override {
    const bool six = address_.host.find(':') != std::string::npos;
    return "http://" + (six ? "[" + address_.host + "]" : address_.host) + ":" +
           std::to_string(address_.port) + "/";
  }

 private:
  using Handled = httplib::Server::HandlerResponse;

  bool on_loopback() const {
    return address_.host.starts_with("127.") || address_.host == "localhost" || address_.host == "::1";
  }

  // A page of somebody else that names this machine as its own is not answered, nor is anything but a
  // question.
  Handled check(const httplib::Request& request, httplib::Response& response) const {
    step_back();
    std::string host = request.get_header_value("Host");
    const size_t port = host.find_last_of(':');
    if (port != std::string::npos && host.find(']', port) == std::string::npos) host.resize(port);
    const bool known = !on_loopback() || host == "localhost" || host == address_.host ||
                       host == "127.0.0.1" || host == "[::1]";
    if (request.method == "GET" && known) return Handled::Unhandled;
    refuse(response, 403, known ? "only questions are answered" : "not served under this name");
    return Handled::Handled;
  }

  Error why_not(int error) const {
    const std::string where = address_.host + ":" + std::to_string(address_.port);
    if (error == EADDRINUSE)
      return bad_input("port " + where + " is taken; another one is chosen with ADDRESS:PORT or PORT");
    return bad_input(where + " cannot be served: " + (error != 0 ? std::strerror(error) : "no such address"));
  }

  void add_answers() {
    server_.Get("/", [this](const httplib::Request&, httplib::Response& response) {
      const Result<std::string> page = answers_.page();
      if (!page) return refuse(response, 500, page.error().message);
      answer(response, *page, "text/html; charset=utf-8");
    });
    if (!answers_.data) return;
    server_.Get("/data", [this](const httplib::Request&, httplib::Response& response) {
      DataAnswer data = answers_.data();
      answer(response, std::move(data.text), "application/jsonl", data.sent);
    });
  }

  void add_frame_answers() {
    if (!answers_.picture) return;
    server_.Get("/picture", [this](const httplib::Request& request, httplib::Response& response) {
      const std::optional<int> frame = number_in(request, "frame"), camera = number_in(request, "camera");
      if (!frame || !camera) return refuse(response, 400, "frame and camera must be numbers");
      const Result<std::string> picture = answers_.picture(*frame, *camera);
      if (!picture) return refuse(response, 404, picture.error().message);
      answer(response, *picture, "image/jpeg");
    });
    server_.Get("/features", [this](const httplib::Request& request, httplib::Response& response) {
      const std::optional<int> frame = number_in(request, "frame"), camera = number_in(request, "camera");
      if (!frame || !camera) return refuse(response, 400, "frame and camera must be numbers");
      answer(response, answers_.features(*frame, *camera), "application/json");
    });
  }

  // A listener has a thread of its own, and waits for nobody but itself.
  void stream_events(httplib::Response& response) {
    if (++listeners_ > kMostListeners) {
      --listeners_;
      return refuse(response, 503, "too many listen already");
    }
    answers_.listeners(1);
    const auto send = [this, listener = Listener(), last = false](size_t, httplib::DataSink& sink) mutable {
      if (last || ending_) return sink.done(), true;
      std::string event;
      last = !answers_.next_event(&listener, &event);
      const std::string text = event.empty() ? ": nothing new\n\n" : "data: " + event + "\n\n";
      return sink.write(text.data(), text.size());
    };
    response.set_chunked_content_provider("text/event-stream", send, [this](bool) {
      --listeners_;
      answers_.listeners(-1);
    });
  }

  ServerAddress address_;
  PageAnswers answers_;
  KeptPipeSignal pipe_signal_;  // before the server is there
  httplib::Server server_;
  std::thread thread_;
  std::atomic<int> listeners_ = 0;
  std::atomic<bool> ending_ = false;
};

}  // namespace

Result<std::unique_ptr<PageServer>> start_page_server(const ServerAddress& address, PageAnswers answers) {
  auto server = std::make_unique<HttpServer>(address, std::move(answers));
  if (auto r = server->start(); !r) return r.error();
  return Result<std::unique_ptr<PageServer>>(std::move(server));
}

}  // namespace raysfm::app

extern "C" const raysfm::app::ServerModule raysfm_server_module = {raysfm::app::start_page_server};
