"""Camera poses and a map from video, whatever the camera.

    import raysfm

    run = raysfm.track("video.mp4", camera="camera.yaml", out="out/")
    print(run.reconstruction.positions)

    tracker = raysfm.Tracker(raysfm.load_cameras("camera.yaml"))
    frame = tracker.push(image, timestamp)      # a uint8 array
    if frame.pose is not None: ...
    run = tracker.finish()

Poses are world_from_rig; axes are x right, y down, z forward; the centre of the first pixel is (0, 0).
"""
from ._raysfm import (BadInputError, Camera, Error, Frame, Frames, InternalError, NoReconstructionError, Reconstruction,
                      Rig, Run, Stop, Tracker, View, Views, __version__, adjust, evaluate, load_cameras, parse_cameras,
                      read_reconstruction, solve, track)
from ._tracks import solve_tracks

__all__ = ["BadInputError", "Camera", "Error", "Frame", "Frames", "InternalError", "NoReconstructionError",
           "Reconstruction", "Rig", "Run", "Stop", "Tracker", "View", "Views", "__version__", "adjust", "evaluate",
           "load_cameras", "parse_cameras", "read_reconstruction", "solve", "solve_tracks", "track"]
