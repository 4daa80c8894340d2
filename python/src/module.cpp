#include <pybind11/pybind11.h>

#include "raysfm/core/heap.h"
#include "raysfm/page/page.h"
#include "raysfm/results/output_folder.h"
#include "support.h"

PYBIND11_MODULE(_raysfm, module) {
  module.doc() = "Camera poses and a map from video, whatever the camera.";
  module.attr("__version__") = RAYSFM_VERSION;
  raysfm::prepare_heap();  // as the program: a Tracker takes a tenth longer without
  if (raysfm::has_page()) raysfm::set_page_writer(raysfm::write_page);
  raysfm::python::bind_errors(module);
  raysfm::python::bind_cameras(module);
  raysfm::python::bind_reconstruction(module);
  raysfm::python::bind_frames(module);
  raysfm::python::bind_tracker(module);
  raysfm::python::bind_runs(module);
  raysfm::python::bind_evaluation(module);
}
