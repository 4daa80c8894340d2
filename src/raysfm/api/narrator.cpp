#include "raysfm/api/narrator.h"

#include <fmt/format.h>

#include <algorithm>

#include "raysfm/scene/weak_links.h"
#include "raysfm/scene/worlds.h"

namespace raysfm {
namespace {

std::string changes_in(const std::vector<CalibrationNumber>& numbers) {
  std::string text;
  for (const CalibrationNumber& n : numbers) {
    if (n.refined == n.given) continue;
    const std::string camera = n.camera > 0 ? fmt::format("camera {} ", n.camera) : "";
    text += fmt::format("{}{}{} {:.6g} instead of {:.6g} (sigma {:.2g})", text.empty() ? "" : ", ", camera,
                        n.name, n.refined, n.given, n.sigma);
  }
  return text.empty() ? "the given one" : text;
}

}  // namespace

void Narrator::world_started(const WorldStarted& e) {
  const std::vector<int>& frames = e.start.frames;
  next_refusal_ = 0;
  if (e.start.inliers == 0) {
    return tell(
        event_, Event::Level::kInfo,
        fmt::format("frames {} to {} only turn: there are orientations, but no map", frames[0], frames[2]));
  }
  tell(event_, Event::Level::kInfo,
       fmt::format("started from frames {}, {}, {} with {} points", frames[0], frames[1], frames[2],
                   e.start.inliers));
}

void Narrator::start_refused(const StartRefused& e) {
  constexpr int kToldEvery = 30;  // frames
  if (e.frame < next_refusal_) return;
  next_refusal_ = e.frame + kToldEvery;
  tell(event_, Event::Level::kWarning, fmt::format("no start yet: {}", e.reason));
}

void Narrator::calibration_refined(const CalibrationRefined& e) {
  const std::string text = changes_in(e.numbers);
  if (e.contradicts) {
    tell(event_, Event::Level::kWarning,
         fmt::format("the lens is another one than that of the {}; at frame {} goes on with {}",
                     origin_.source, e.frame, text));
  } else {
    tell(event_, Event::Level::kInfo, fmt::format("calibration refined at frame {}: {}", e.frame, text));
  }
}

void Narrator::track_lost(const TrackLost& e) {
  next_refusal_ = 0;
  tell(event_, Event::Level::kWarning, fmt::format("track lost at frame {}: {}", e.frame, e.reason));
}

void Narrator::track_found(const TrackFound& e) {
  tell(event_, Event::Level::kInfo,
       fmt::format("track found again at frame {} in key frame {}", e.frame, e.keyframe));
}

void Narrator::place_seen_again(const PlaceSeenAgain& e) {
  const Closure& c = e.closure;
  const std::string earlier =
      c.with_frame < 0 ? "an earlier run" : fmt::format("frame {}", c.with_frame);  // that the map is of
  tell(event_, Event::Level::kInfo,
       fmt::format("frame {} sees what {} saw ({} points): {}", c.frame, earlier, c.inliers,
                   c.joined_worlds ? "worlds joined" : "loop closed"));
}

void Narrator::marks_found(const MarksFound& e) {
  tell(
      event_, Event::Level::kInfo,
      fmt::format("{:.0f} % of the image stays in its place while the rest moves (a text, a logo, a bonnet): "
                  "it is left out from frame {} on",
                  100 * e.part, e.frame));
}

std::string zoom_warning(const SeenZoom& change) {
  return fmt::format(
      "the camera zooms: its focal length is {:.0f} px before frame {} and {:.0f} px from there on; "
      "poses are of one lens, raysfm solve finds a lens for each image",
      change.before, change.frame, change.after);
}

std::string motion_warning(const std::vector<OtherMotion>& seen) {
  if (seen.empty()) return "";
  const OtherMotion& most = *std::ranges::max_element(seen, {}, &OtherMotion::part);
  const std::string more = seen.size() > 1 ? fmt::format(", and in {} more stretches", seen.size() - 1) : "";
  return fmt::format(
      "{:.0f} % of what frames {} to {} show does not stand still in the world that was tracked{}: the path "
      "may be that of something that moves",
      100 * most.part, most.first, most.last, more);
}

std::string dropped_shutter_warning(bool is_dropped) {
  return is_dropped ? "rows of the images are exposed in one order in a part of the footage and in the other "
                      "in another, as where a part plays backwards: no rolling shutter is taken into account"
                    : "";
}

std::string start_warning(const Reconstruction& r) {
  constexpr int kMayGrow = 10;  // frames with a pose, from which on another key frame is to be expected
  const std::vector<int> worlds = worlds_in_order(r);
  if (worlds.empty() || r.points.empty()) return "";  // of turns alone there is no map
  const auto in_main = [&](const PosedFrame& frame) { return frame.segment == worlds[0]; };
  const auto frames = std::ranges::count_if(r.frames, in_main);
  const auto keyframes =
      std::ranges::count_if(r.keyframes, [&](const KeyFrame& k) { return in_main(r.frames[k.frame]); });
  if (frames < kMayGrow || keyframes != 3) return "";
  return fmt::format(
      "the map is that of the three views which started it, and none of {} frames has added to it: nothing "
      "later says that it is right",
      frames);
}

std::string link_warning(const Reconstruction& r) {
  const std::vector<WeakLink> links = weak_links(r);
  if (links.empty()) return "";
  const WeakLink& weakest = *std::ranges::min_element(links, {}, &WeakLink::points);
  const std::string more =
      links.size() > 1 ? fmt::format(", and {} more places by few", links.size() - 1) : "";
  return fmt::format(
      "frames {} to {} are held together by {} points ({:.0f} in the median){}: the path may have another "
      "scale after them than before",
      weakest.first, weakest.last, weakest.points, weakest.usual, more);
}

}  // namespace raysfm
