#include "live_view.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <utility>

#include "live_picture.h"
#include "raysfm/odometry/tracker.h"
#include "raysfm/page/page.h"
#include "raysfm/page/page_data.h"

namespace raysfm::app {
namespace {

using namespace std::chrono_literals;

constexpr size_t kMostPoses = 20000;
constexpr size_t kMostPosesAtOnce = 5000;
constexpr auto kBetweenEvents = 200ms, kLastWait = 3000ms;
constexpr auto kBetweenPictures = 200ms, kPictureWait = 1000ms;
constexpr double kLeastBetweenMapsMs = 2000;
constexpr double kShareOfTime = 100;  // a map is copied and sent for one part in so many

}  // namespace

Result<std::unique_ptr<LiveView>> LiveView::start(const ServerAddress& address, const std::string& title) {
  if (!has_page()) return bad_input("--view: this build has no page: npm was not there when it was made");
  std::unique_ptr<LiveView> view(new LiveView(title));
  Result<std::unique_ptr<PageServer>> server = start_page_server(address, view->answers());
  if (!server) return bad_input("--view: " + server.error().message);
  view->server_ = *std::move(server);
  return Result<std::unique_ptr<LiveView>>(std::move(view));
}

LiveView::~LiveView() {
  const std::lock_guard lock(mutex_);
  if (!over_) state_ = "the run has ended without a result";
  over_ = true;
  news_.notify_all();
}

PageAnswers LiveView::answers() {
  return {
      .page = [this] { return page(); },
      .data = [this] { return data(); },
      .picture = [this](int frame, int camera) { return picture(frame, camera); },
      .features = [this](int frame, int camera) { return features(frame, camera); },
      .next_event = [this](Listener* listener, std::string* event) { return next_event(listener, event); },
      .listeners = [this](int change) { listeners_ += change; }};
}

void LiveView::frame_posed(const FramePosed& e) {
  newest_ = {e.frame, e.world, e.world_from_rig};
  any_pose_ = true;
  const std::lock_guard lock(mutex_);
  poses_.push_back(newest_);
  if (poses_.size() <= kMostPoses) return;
  poses_.pop_front();
  ++poses_before_;
}

void LiveView::track_lost(const TrackLost& e) {
  const std::lock_guard lock(mutex_);
  trouble_ = fmt::format(" · lost at frame {}: {}", e.frame, e.reason);
}

void LiveView::track_found(const TrackFound&) {
  const std::lock_guard lock(mutex_);
  trouble_.clear();
}

void LiveView::map_adjusted(const MapAdjusted& e) {
  if (e.rescaled != 1) forget_poses();
}

void LiveView::calibration_refined(const CalibrationRefined&) {
  forget_poses();
}

void LiveView::place_seen_again(const PlaceSeenAgain&) {
  forget_poses();
}

// They were in another place, or in other units.
void LiveView::forget_poses() {
  const std::lock_guard lock(mutex_);
  poses_before_ += poses_.size();
  poses_.clear();
}

void LiveView::frame_done(const Tracker& tracker) {
  if (listeners_ == 0) return;
  show_newest(tracker);
  const Clock::time_point now = Clock::now();
  if (!any_pose_ || now < next_map_) return;
  double spent = 0;
  {
    const std::lock_guard lock(mutex_);
    spent = data_ms_;
  }
  Map map = std::make_shared<const Reconstruction>(tracker.snapshot());
  spent += milliseconds_since(now);
  next_map_ = now + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double, std::milli>(
                        std::max(kLeastBetweenMapsMs, kShareOfTime * spent)));
  PageInfo info = {.title = info_.title,
                   .stages = {},
                   .pictures = tracker.rig().size(),
                   .live = LiveInfo{newest_.frame, newest_.world}};
  const std::lock_guard lock(mutex_);
  offer(std::move(map), std::move(info));
}

void LiveView::show_newest(const Tracker& tracker) {
  const Clock::time_point now = Clock::now();
  if (!picture_wanted_ || now < next_picture_) return;
  const auto seen = std::make_shared<const NewestView>(tracker.newest_view());
  if (!seen->view) return;
  picture_wanted_ = false;
  next_picture_ = now + kBetweenPictures;
  const std::lock_guard lock(mutex_);
  seen_ = seen;
  news_.notify_all();
}

// The newest view that was shown, at that frame or a later one where that comes soon.
std::shared_ptr<const NewestView> LiveView::seen_from(int frame) {
  std::unique_lock lock(mutex_);
  const auto is_there = [&] { return over_ || (seen_ && seen_->view->frame >= frame); };
  if (!is_there()) {
    picture_wanted_ = true;
    news_.wait_for(lock, kPictureWait, is_there);
  }
  return seen_;
}

Result<std::string> LiveView::picture(int frame, int camera) {
  const std::shared_ptr<const NewestView> seen = seen_from(frame);
  return seen ? picture_of(*seen->view, camera) : bad_input("no picture yet");
}

std::string LiveView::features(int frame, int camera) {
  const std::shared_ptr<const NewestView> seen = seen_from(frame);
  const bool is_known = seen && camera >= 0 && camera < static_cast<int>(seen->view->cameras.size());
  return is_known ? features_of(*seen, camera) : "{}";
}

void LiveView::offer(Map map, PageInfo info) {
  map_ = std::move(map);
  info_ = std::move(info);
  ++revision_;
}

void LiveView::say(const std::string& state) {
  const std::lock_guard lock(mutex_);
  state_ = state;
}

void LiveView::finish(const Reconstruction& result, const Report& report) {
  std::unique_lock lock(mutex_);
  offer(std::make_shared<const Reconstruction>(result), page_info(report));
  state_ = "the run has ended";
  trouble_.clear();
  over_ = true;
  news_.notify_all();
  const int looking = listeners_;
  news_.wait_for(lock, kLastWait, [&] { return fetched_ >= std::min<int>(looking, listeners_); });
}

Result<std::string> LiveView::page() {
  const std::lock_guard lock(mutex_);
  PageInfo info = {.title = info_.title, .stages = {}, .pictures = 0, .live = LiveInfo()};
  return page_html(Reconstruction(), info, true);
}

DataAnswer LiveView::data() {
  Map map;
  PageInfo info;
  bool over = false;
  {
    const std::lock_guard lock(mutex_);
    map = map_;
    info = info_;
    over = over_;
  }
  const Clock::time_point start = Clock::now();
  PageData data = page_data(map ? *map : Reconstruction(), info);
  const std::lock_guard lock(mutex_);
  data_ms_ = milliseconds_since(start);
  return {std::move(data.first) + '\n' + data.rest, [this, over] { count_fetched(over); }};
}

void LiveView::count_fetched(bool result) {
  const std::lock_guard lock(mutex_);
  fetched_ += result;
  news_.notify_all();
}

bool LiveView::next_event(Listener* listener, std::string* event) {
  std::unique_lock lock(mutex_);
  news_.wait_for(lock, listener->new_here ? 0ms : kBetweenEvents, [this] { return over_; });
  listener->new_here = false;
  nlohmann::json frames = nlohmann::json::array();
  const size_t first = std::max(listener->heard, poses_before_) - poses_before_;
  const int world = poses_.empty() ? -1 : poses_.back().world;
  const size_t skipped = poses_.size() > kMostPosesAtOnce ? poses_.size() - kMostPosesAtOnce : 0;
  for (size_t i = std::max(first, skipped); i < poses_.size(); ++i) {
    const auto& [frame, of_world, pose] = poses_[i];
    if (of_world != world) continue;
    const auto round = [](double x) { return static_cast<float>(x); };
    const Eigen::Vector3d& t = pose.translation;
    const Eigen::Vector4d q = pose.rotation.coeffs();
    frames.push_back({frame, round(t.x()), round(t.y()), round(t.z()), round(q[0]), round(q[1]), round(q[2]),
                      round(q[3])});
  }
  listener->heard = poses_before_ + poses_.size();
  *event = nlohmann::json{
      {"map", revision_},
      {"world", world},
      {"frames", std::move(frames)},
      {"state", state_ + trouble_},
      {"over",
       over_}}.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  return !over_;
}

namespace {

// The value may be left out, so that the word behind the flag can be meant for something else.
CLI::Validator an_address() {
  return {[](std::string& text) -> std::string {
            if (text.empty() || text == "true" || parse_server_address("", text)) return "";
            return "'" + text +
                   "' is not allowed, PORT or ADDRESS:PORT are, a port from 1 to 65535; INPUT comes before "
                   "the flag";
          },
          ""};
}

}  // namespace

void ViewFlag::add_to(CLI::App* command) {
  option_ = command
                ->add_option("--view", text_,
                             "watch the run in a browser; without an address only this machine can")
                ->expected(0, 1)
                ->check(an_address())
                ->type_name("[[ADDRESS:]PORT]");
}

Result<std::unique_ptr<LiveView>> ViewFlag::start(const std::vector<std::string>& inputs) const {
  if (option_->count() == 0) return std::unique_ptr<LiveView>();
  const bool plain = option_->results().empty() || option_->results()[0].empty() || text_ == "true";
  const Result<ServerAddress> address = plain ? ServerAddress() : parse_server_address("--view", text_);
  if (!address) return address.error();
  return LiveView::start(*address, title_of(inputs));
}

}  // namespace raysfm::app
