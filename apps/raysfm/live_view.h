#pragma once

#include <CLI/CLI.hpp>
#include <atomic>
#include <condition_variable>
#include <deque>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "page_server.h"
#include "raysfm/api/track.h"
#include "raysfm/core/timer.h"
#include "raysfm/page/page_info.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {
struct NewestView;
}

namespace raysfm::app {

// A run under way as browsers see it. The run leaves its newest state here and goes on: poses one by one, and
// now and then a copy of the map, for no more than a hundredth of the time and only while somebody looks.
// Pictures of the newest frame are made on the server's threads, from images that the run has anyway. Whoever
// is slow misses what is older; memory does not grow with them.
class LiveView : public TrackWatcher {
 public:
  // Serves from now on. Errors: bad input, where the address is not to be had or this build has no page.
  static Result<std::unique_ptr<LiveView>> start(const ServerAddress& address, const std::string& title);
  ~LiveView() override;

  std::string url() const { return server_->url(); }

  void frame_posed(const FramePosed& e) override;
  void track_lost(const TrackLost& e) override;
  void track_found(const TrackFound& e) override;
  void map_adjusted(const MapAdjusted& e) override;
  void calibration_refined(const CalibrationRefined& e) override;
  void place_seen_again(const PlaceSeenAgain& e) override;
  void frame_done(const Tracker& tracker) override;
  // One line that says where the run is.
  void say(const std::string& state);
  // The result: those who look have three seconds to fetch it.
  void finish(const Reconstruction& result, const Report& report);

 private:
  struct Pose {
    int frame = 0, world = 0;
    Rigid3 world_from_rig;
  };
  using Map = std::shared_ptr<const Reconstruction>;

  explicit LiveView(std::string title) { info_.title = std::move(title); }
  PageAnswers answers();
  Result<std::string> page();
  DataAnswer data();
  void count_fetched(bool result);
  bool next_event(Listener* listener, std::string* event);
  void forget_poses();
  void show_newest(const Tracker& tracker);
  std::shared_ptr<const NewestView> seen_from(int frame);
  Result<std::string> picture(int frame, int camera);
  std::string features(int frame, int camera);
  void offer(Map map, PageInfo info);

  std::atomic<int> listeners_ = 0;
  std::atomic<bool> picture_wanted_ = false;
  Clock::time_point next_map_ = Clock::now();      // not before; of the run's thread alone
  Clock::time_point next_picture_ = Clock::now();  // likewise
  Pose newest_;                                    // likewise
  bool any_pose_ = false;                          // likewise

  std::mutex mutex_;  // of all below
  std::condition_variable news_;
  std::deque<Pose> poses_;   // the newest
  size_t poses_before_ = 0;  // that are no longer in it
  std::string state_ = "the run begins", trouble_;
  Map map_;  // null: none yet
  PageInfo info_;
  int revision_ = 0;    // of the map
  double data_ms_ = 0;  // that it took last to put the map into words
  bool over_ = false;
  int fetched_ = 0;                         // times that the result was
  std::shared_ptr<const NewestView> seen_;  // with a view; null: nobody asked yet

  std::unique_ptr<PageServer> server_;  // the first to go
};

// The flag --view of commands that run for long.
class ViewFlag {
 public:
  void add_to(CLI::App* command);
  // What it asks for; null: nothing. Errors: bad input.
  Result<std::unique_ptr<LiveView>> start(const std::vector<std::string>& inputs) const;

 private:
  std::string text_;
  CLI::Option* option_ = nullptr;
};

}  // namespace raysfm::app
