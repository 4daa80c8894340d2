#include "raysfm/merging/join_pieces.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "raysfm/geometry/interpolation.h"
#include "raysfm/scene/worlds.h"
#include "raysfm/views/map_result.h"
#include "raysfm/views/tracking_rig.h"

namespace raysfm {
namespace {

// A key frame of a piece, by which frames near to it go over into the joined world.
struct Anchor {
  double timestamp = 0;
  int world = 0;         // of the joined map
  Rigid3 before, after;  // rig_from_world in the piece, and in the joined map
  double scale = 1;      // unit of the piece in that of the joined world, here
};

// Where a frame of the joined result comes from.
struct FramePlace {
  double timestamp = 0;
  int piece = 0, frame = 0;
};

// A pose brought from a piece into the joined world.
struct MovedPose {
  Rigid3 rig_from_world;
  double scale = 1;
};

MovedPose moved_by(const Anchor& anchor, const Rigid3& rig_from_world) {
  Rigid3 rig_from_anchor = rig_from_world * anchor.before.inverse();
  rig_from_anchor.translation *= anchor.scale;
  return {rig_from_anchor * anchor.after, anchor.scale};
}

// From what the way along some key frames to both sides was and is: a single step may be one of turning.
void measure_scales(std::vector<Anchor>* anchors) {
  constexpr int kReach = 4;
  const int count = static_cast<int>(anchors->size());
  const auto step = [&](int k, Rigid3 Anchor::*pose) {
    return (((*anchors)[k].*pose).inverse().translation - ((*anchors)[k - 1].*pose).inverse().translation)
        .norm();
  };
  for (int k = 0; k < count; ++k) {
    double before = 0, after = 0;
    for (int i = std::max(1, k - kReach + 1); i <= std::min(count - 1, k + kReach); ++i) {
      before += step(i, &Anchor::before);
      after += step(i, &Anchor::after);
    }
    if (before > 0 && after > 0) (*anchors)[k].scale = after / before;
  }
}

class PieceJoiner {
 public:
  explicit PieceJoiner(std::vector<VideoPiece> pieces) : pieces_(std::move(pieces)) {}

  Result<JoinedPieces> join(uint64_t seed) {
    for (const VideoPiece& piece : pieces_) {
      if (piece.result.origin == Origin::kTrack) continue;
      return bad_input(piece.name + ": a result of another command; allowed: results of track");
    }
    const auto begin = [](const VideoPiece& p) { return p.result.frames.front().timestamp; };
    std::erase_if(pieces_, [](const VideoPiece& p) { return p.result.frames.empty(); });
    std::ranges::stable_sort(pieces_, {}, begin);
    std::vector<NamedMap> maps;
    for (size_t p = 0; p < pieces_.size(); ++p) {
      if (posed_count(pieces_[p].result) == 0) continue;
      maps.push_back({pieces_[p].name, std::exchange(pieces_[p].map, {}), pieces_[p].result.calibration});
      piece_of_map_.push_back(static_cast<int>(p));
    }
    if (maps.empty()) return no_reconstruction("no frame of any piece has a pose");
    out_.range = {pieces_.front().result.range.from, pieces_.back().result.range.to};
    const Result<std::vector<KnownView>> known = known_views(maps);
    if (!known) return known.error();
    Result<MergedMaps> merged = merge_maps(std::move(maps), seed, *known);
    if (!merged) return merged.error();
    merged_ = *std::move(merged);
    find_anchors();
    list_frames();
    for (const FramePlace& place : places_) out_.frames.push_back(moved_frame(place));
    make_segments();
    fill_map();
    return JoinedPieces{std::move(out_), std::move(merged_.map), std::move(merged_.worlds)};
  }

 private:
  const PosedFrame& frame_of(const FramePlace& place) const {
    return pieces_[place.piece].result.frames[place.frame];
  }

  // The frame of a piece at a time, where it has a pose; null where it has none.
  const PosedFrame* posed_at(int piece, double timestamp) const {
    const std::vector<PosedFrame>& frames = pieces_[piece].result.frames;
    const auto frame = std::ranges::lower_bound(frames, timestamp, {}, &PosedFrame::timestamp);
    const bool is_there = frame != frames.end() && frame->timestamp == timestamp && frame->world_from_rig;
    return is_there ? &*frame : nullptr;
  }

  Error of_another_run(int piece, double timestamp) const {
    return bad_input(fmt::format("{}: the map is of another run, its key frame of {} s has no pose",
                                 pieces_[piece].name, timestamp));
  }

  // The world of the map in which each segment of a piece is; -1: none.
  Result<std::vector<int>> worlds_of_segments(int piece, const SavedMap& map) const {
    std::vector<int> world_of(pieces_[piece].result.segments.size(), -1);
    for (size_t w = 0; w < map.worlds.size(); ++w) {
      for (const KeyFrameSource& source : map.worlds[w].sources) {
        const PosedFrame* frame = posed_at(piece, source.timestamp);
        if (!frame) return of_another_run(piece, source.timestamp);
        world_of[frame->segment] = static_cast<int>(w);
      }
    }
    return world_of;
  }

  // Key frames that are frames of other pieces too.
  Result<std::vector<KnownView>> known_views(const std::vector<NamedMap>& maps) const {
    std::vector<std::vector<int>> world_of;
    for (size_t m = 0; m < maps.size(); ++m) {
      Result<std::vector<int>> of_piece = worlds_of_segments(piece_of_map_[m], maps[m].map);
      if (!of_piece) return of_piece.error();
      world_of.push_back(*std::move(of_piece));
    }
    std::vector<KnownView> known;
    for (int m = 0; m < static_cast<int>(maps.size()); ++m) {
      for (int w = 0; w < static_cast<int>(maps[m].map.worlds.size()); ++w) {
        const std::vector<KeyFrameSource>& sources = maps[m].map.worlds[w].sources;
        for (int k = 0; k < static_cast<int>(sources.size()); ++k) {
          for (int other = 0; other < static_cast<int>(maps.size()); ++other) {
            const PosedFrame* frame =
                other == m ? nullptr : posed_at(piece_of_map_[other], sources[k].timestamp);
            if (!frame || world_of[other][frame->segment] < 0) continue;
            known.push_back(
                {m, w, k, other, world_of[other][frame->segment], frame->world_from_rig->inverse()});
          }
        }
      }
    }
    return known;
  }

  // anchors_[piece][segment], in time order.
  void find_anchors() {
    for (const VideoPiece& piece : pieces_) anchors_.emplace_back(piece.result.segments.size());
    for (size_t w = 0; w < merged_.map.worlds.size(); ++w) {
      const SavedWorld& world = merged_.map.worlds[w];
      for (size_t k = 0; k < world.sources.size(); ++k) {
        const int p = piece_of_map_[merged_.map_of_keyframe[w][k]];
        const double timestamp = world.sources[k].timestamp;
        const PosedFrame* frame = posed_at(p, timestamp);
        anchors_[p][frame->segment].push_back({timestamp, static_cast<int>(w),
                                               frame->world_from_rig->inverse(),
                                               world.map.keyframes[k].rig_from_world, 1});
      }
    }
    for (auto& of_piece : anchors_) {
      for (std::vector<Anchor>& anchors : of_piece) {
        std::ranges::sort(anchors, {}, &Anchor::timestamp);
        measure_scales(&anchors);
      }
    }
  }

  void list_frames() {
    std::vector<FramePlace> all;
    for (size_t p = 0; p < pieces_.size(); ++p) {
      for (size_t f = 0; f < pieces_[p].result.frames.size(); ++f) {
        all.push_back({pieces_[p].result.frames[f].timestamp, static_cast<int>(p), static_cast<int>(f)});
      }
    }
    std::ranges::stable_sort(all, {}, &FramePlace::timestamp);
    for (const FramePlace& place : all) {
      if (places_.empty() || places_.back().timestamp != place.timestamp) {
        places_.push_back(place);
      } else if (worth(place) > worth(places_.back())) {
        places_.back() = place;
      }
    }
  }

  // Poses in the middle of a piece have been seen from both sides.
  std::pair<bool, int> worth(const FramePlace& place) const {
    const int count = static_cast<int>(pieces_[place.piece].result.frames.size());
    return {frame_of(place).world_from_rig.has_value(), std::min(place.frame, count - 1 - place.frame)};
  }

  // The name of a frame's image; those of a video are numbered by their piece.
  std::string joined_name(const FramePlace& place, size_t number) const {
    const std::string& name = frame_of(place).image_name;
    return name == fmt::format("frame-{:06}", place.frame) ? fmt::format("frame-{:06}", number) : name;
  }

  // A result has the names of its key frames alone: the piece that a frame comes from may know none.
  void name_keyframe(int piece, double timestamp, int number) {
    std::string& name = out_.frames[number].image_name;
    if (!name.empty()) return;
    const int frame = static_cast<int>(posed_at(piece, timestamp) - pieces_[piece].result.frames.data());
    name = joined_name({timestamp, piece, frame}, number);
  }

  PosedFrame moved_frame(const FramePlace& place) const {
    PosedFrame frame = frame_of(place);
    frame.image_name = joined_name(place, out_.frames.size());
    if (!frame.world_from_rig) return frame;
    const std::vector<Anchor>& anchors = anchors_[place.piece][frame.segment];
    if (anchors.empty()) {
      frame.world_from_rig.reset();
      frame.segment = -1;
      frame.reason = "nothing of its world is in the saved map";
      return frame;
    }
    const Rigid3 before = frame.world_from_rig->inverse();
    const auto next = std::ranges::upper_bound(anchors, frame.timestamp, {}, &Anchor::timestamp);
    MovedPose moved = moved_by(next == anchors.begin() ? *next : *(next - 1), before);
    if (next != anchors.begin() && next != anchors.end()) {
      const Anchor &a = *(next - 1), &b = *next;
      const double part = (frame.timestamp - a.timestamp) / (b.timestamp - a.timestamp);
      const MovedPose from_b = moved_by(b, before);
      moved.rig_from_world = interpolate(moved.rig_from_world, from_b.rig_from_world, part);
      moved.scale += part * (from_b.scale - moved.scale);
    }
    frame.segment = anchors[0].world;
    set_pose(moved, &frame);
    return frame;
  }

  static void set_pose(const MovedPose& moved, PosedFrame* frame) {
    const Rigid3 world_from_rig = moved.rig_from_world.inverse();
    const Eigen::Matrix3d turn =
        (world_from_rig.rotation * frame->world_from_rig->rotation.inverse()).toRotationMatrix();
    Matrix6d change = Matrix6d::Zero();
    change.topLeftCorner<3, 3>() = moved.scale * turn;
    change.bottomRightCorner<3, 3>() = turn;
    frame->covariance = (change * frame->covariance * change.transpose()).eval();
    frame->world_from_rig = world_from_rig;
  }

  // A segment for each world of the joined map that a frame is in, as its first piece started it.
  void make_segments() {
    segment_of_.assign(merged_.map.worlds.size(), -1);
    for (size_t f = 0; f < out_.frames.size(); ++f) {
      PosedFrame& frame = out_.frames[f];
      if (frame.segment < 0) continue;
      const int world = frame.segment;
      const FramePlace& place = places_[f];
      const Reconstruction& piece = pieces_[place.piece].result;
      const int of_piece = frame_of(place).segment;
      if (segment_of_[world] < 0) {
        segment_of_[world] = static_cast<int>(out_.segments.size());
        const double sigma = merged_.map.worlds[world].map.scale_sigma;
        out_.segments.push_back({static_cast<int>(f), 0, "", sigma < kMetricSigma, {}});
        if (std::isfinite(sigma)) out_.segments.back().scale_sigma = sigma;
        out_.starts.push_back(joined_start(place.piece, piece.starts[of_piece]));
      }
      frame.segment = segment_of_[world];
      out_.segments[frame.segment].last = static_cast<int>(f);
      out_.segments[frame.segment].reason = piece.segments[of_piece].reason;
    }
  }

  // -1: not in the result.
  int number_of(double timestamp) const {
    const auto place = std::ranges::lower_bound(places_, timestamp, {}, &FramePlace::timestamp);
    const bool found = place != places_.end() && place->timestamp == timestamp;
    return found ? static_cast<int>(place - places_.begin()) : -1;
  }

  int joined_number(int piece, int frame) const {
    return frame < 0 ? -1 : number_of(pieces_[piece].result.frames[frame].timestamp);
  }

  StartSummary joined_start(int piece, StartSummary start) const {
    for (int& frame : start.frames) frame = joined_number(piece, frame);
    return start;
  }

  void fill_map() {
    out_.rig = merged_.map.rig;
    out_.calibration = merged_.calibration;
    for (size_t p = 0; p < pieces_.size(); ++p) {
      for (Closure closure : pieces_[p].result.closures) {
        closure.frame = joined_number(static_cast<int>(p), closure.frame);
        closure.with_frame = joined_number(static_cast<int>(p), closure.with_frame);
        out_.closures.push_back(closure);
      }
    }
    std::ranges::stable_sort(out_.closures, {}, &Closure::frame);
    std::vector<Map> maps;
    for (size_t w = 0; w < merged_.map.worlds.size(); ++w) {
      const SavedWorld& world = merged_.map.worlds[w];
      maps.push_back(world.map);
      std::vector<uint8_t> taken(out_.frames.size(), 0);
      for (size_t k = 0; k < world.sources.size(); ++k) {
        // A frame of two pieces may have been a key frame of both.
        const int frame = number_of(world.sources[k].timestamp);
        const bool here = frame >= 0 && out_.frames[frame].segment == segment_of_[w];
        if (here)
          name_keyframe(piece_of_map_[merged_.map_of_keyframe[w][k]], world.sources[k].timestamp, frame);
        maps.back().keyframes[k].frame = here && !std::exchange(taken[frame], 1) ? frame : -1;
      }
    }
    append_maps(TrackingRig(out_.rig), std::move(maps), segment_of_, &out_);
    std::ranges::sort(out_.keyframes, {}, &KeyFrame::frame);
  }

  std::vector<VideoPiece> pieces_;
  std::vector<int> piece_of_map_;  // pieces without a pose have no map
  MergedMaps merged_;
  std::vector<std::vector<std::vector<Anchor>>> anchors_;
  std::vector<FramePlace> places_;  // by frame of the result
  std::vector<int> segment_of_;     // by world of the joined map; -1: no frame is in it
  Reconstruction out_;
};

}  // namespace

Result<JoinedPieces> join_pieces(std::vector<VideoPiece> pieces, uint64_t seed) {
  return PieceJoiner(std::move(pieces)).join(seed);
}

}  // namespace raysfm
