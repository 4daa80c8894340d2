#!/usr/bin/env python3
"""track_frames.py INPUT CAMERA.yaml [IMAGE.png]: tracks a video frame by frame and plots path, uncertainty and time.

The images are arrays, as any camera gives them: replace raysfm.Frames() by your own. Without IMAGE.png a window opens.
"""
import sys
import time

import matplotlib
import numpy

if len(sys.argv) > 3:
    matplotlib.use("Agg")
from matplotlib import pyplot

import raysfm


def main():
    if len(sys.argv) not in (3, 4):
        sys.exit(__doc__)
    try:
        tracker = raysfm.Tracker(raysfm.load_cameras(sys.argv[2]))
        positions, sigmas, milliseconds = [], [], []
        for images, timestamp, name in raysfm.Frames(sys.argv[1]):
            start = time.perf_counter()
            frame = tracker.push(images, timestamp, name)
            milliseconds.append(1000 * (time.perf_counter() - start))
            position, covariance = frame.position, frame.covariance
            if position is None or covariance is None:  # frame.reason says why
                position, covariance = numpy.full(3, numpy.nan), numpy.full((6, 6), numpy.nan)
            positions.append(position)
            sigmas.append(numpy.sqrt(numpy.trace(covariance[:3, :3])))
        result = tracker.finish().reconstruction
    except raysfm.Error as error:
        sys.exit(f"track_frames: {error}")
    live, final = numpy.array(positions), result.positions
    print(f"{tracker.posed} of {tracker.frames} frames posed, {numpy.median(milliseconds):.1f} ms a frame")

    figure, (above, below, timing) = pyplot.subplots(3, figsize=(9, 11), height_ratios=[3, 1, 1])
    above.plot(live[:, 0], live[:, 2], ".", markersize=3, color="tab:orange", label="as the frame came")
    above.plot(final[:, 0], final[:, 2], color="tab:blue", label="in the end")
    above.set(aspect="equal", xlabel="x", ylabel="z")
    above.legend()
    below.plot(sigmas)
    below.set(ylabel="sigma of the position")
    timing.plot(milliseconds, linewidth=0.7)
    timing.set(xlabel="frame", ylabel="ms")
    if len(sys.argv) == 4:
        figure.savefig(sys.argv[3], dpi=110)
    else:
        pyplot.show()


if __name__ == "__main__":
    main()
