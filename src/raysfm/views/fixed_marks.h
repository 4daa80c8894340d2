#pragma once

#include <vector>

#include "raysfm/core/archive.h"
#include "raysfm/views/view.h"
#include "raysfm/views/view_archive.h"

namespace raysfm {

// What stays in its place in the images while the rest of them moves: a text or a logo laid over a film, the
// bonnet of a car. It moves with the camera, says nothing of the scene, and looks as sharp as anything. Where
// half of the image has moved by three pixels, that is a step; corners that were found at the same place with
// the same patch in three quarters of 16 steps are marks.
class FixedMarks {
 public:
  // The next view, with corners. Views that are no newer than one before are passed over. Whether marks were
  // found in it.
  bool watch(const View& view);

  // Whether something has stayed for some steps: the sooner more views come, the sooner it is known.
  bool is_in_doubt() const;

  // The view without the corners about the marks that were known when it came; itself where there are none.
  ViewPtr without(const ViewPtr& view) const;

  // Marks found so far hold for frames from this one on.
  void hold_from(int frame);

  // Whether a pixel of a camera lies about a mark.
  bool covers(int camera, const Eigen::Vector2f& pixel) const;

  bool empty() const { return marks_.empty(); }

  // Part of the images that lies about marks, 0 to 1.
  double part_of(const View& view) const;

  template <typename A>
  void archive(A& a) {
    raysfm::archive(a, newest_, steps_, cameras_, marks_);
  }

 private:
  // A corner of the view that a round began with, which has not moved since.
  struct Suspect {
    Eigen::Vector2f pixel = Eigen::Vector2f::Zero();
    uint8_t octave = 0;
    int found = 0;  // in how many steps

    template <typename A>
    void archive(A& a) {
      raysfm::archive(a, pixel, octave, found);
    }
  };
  struct Watched {
    Features base;  // corners of the newest step
    PatchSet base_patches;
    std::vector<Suspect> suspects;
    PatchSet patches;  // of the suspects

    template <typename A>
    void archive(A& a) {
      raysfm::archive(a, base.pixels, base.scores, base.octaves, base_patches, suspects, patches);
    }
  };
  struct Mark {
    Eigen::Vector2f pixel = Eigen::Vector2f::Zero();
    uint8_t camera = 0;
    float reach = 0;  // pixels
    int since = 0;    // frame

    template <typename A>
    void archive(A& a) {
      raysfm::archive(a, pixel, camera, reach, since);
    }
    bool covers(int other_camera, const Eigen::Vector2f& other) const {
      return camera == other_camera && (other - pixel).squaredNorm() <= reach * reach;
    }
  };

  void begin_round(const View& view);
  std::vector<int> unmarked(const CameraView& view, int camera) const;
  void take_base(const View& view, int c, Watched* camera) const;
  bool has_moved(const View& view) const;
  bool is_strong(const Suspect& suspect) const;
  void keep_unmoved(const CameraView& view, Watched* camera) const;
  bool end_round(const View& view);

  int newest_ = -1;  // frame
  int steps_ = 0;    // of the present round
  std::vector<Watched> cameras_;
  std::vector<Mark> marks_;
};

}  // namespace raysfm
