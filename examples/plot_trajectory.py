#!/usr/bin/env python3
"""plot_trajectory.py RESULT [IMAGE.png]: path and map of a finished run from above, with 90 % ellipses of some positions.

RESULT is an output folder of track, solve or adjust. Without IMAGE.png a window opens.
"""
import sys

import matplotlib
import numpy

if len(sys.argv) > 2:
    matplotlib.use("Agg")
from matplotlib import pyplot
from matplotlib.patches import Ellipse

import raysfm

CHI2 = 4.605  # 90 % of two degrees of freedom


def ellipse(position, covariance):
    """Where the camera is, in the plane x, z."""
    plane = covariance[numpy.ix_([0, 2], [0, 2])]
    values, axes = numpy.linalg.eigh(plane)
    width, height = 2 * numpy.sqrt(CHI2 * numpy.maximum(values, 0))
    angle = numpy.degrees(numpy.arctan2(axes[1, 0], axes[0, 0]))
    return Ellipse(position[[0, 2]], width, height, angle=angle, fill=False, color="tab:red")


def main():
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    try:
        result = raysfm.read_reconstruction(sys.argv[1])
    except raysfm.BadInputError as error:
        sys.exit(f"plot_trajectory: {error}")
    if not result.worlds:
        sys.exit("plot_trajectory: no frame has a pose")
    main_world = result.worlds[0]["segment"]
    seen = result.segment_of_point == main_world
    posed = result.segment_of_frame == main_world
    points, path = result.points[seen], result.positions[posed]

    figure, axes = pyplot.subplots(figsize=(9, 9))
    axes.scatter(points[:, 0], points[:, 2], s=1, c=result.colors[seen] / 255, linewidths=0)
    axes.plot(path[:, 0], path[:, 2], color="tab:blue", label=f"{len(path)} of {len(posed)} frames")
    for frame in numpy.flatnonzero(posed)[::10]:
        axes.add_patch(ellipse(result.positions[frame], result.covariances[frame]))
    low, high = numpy.percentile(numpy.vstack([points[:, [0, 2]], path[:, [0, 2]]]), [2, 98], axis=0)
    margin = 0.1 * (high - low).max()
    axes.set(xlim=(low[0] - margin, high[0] + margin), ylim=(low[1] - margin, high[1] + margin), aspect="equal",
             xlabel="x", ylabel="z" + (" [m]" if result.metric_scale else ", unit arbitrary"))
    axes.legend()
    if len(sys.argv) == 3:
        figure.savefig(sys.argv[2], dpi=110)
    else:
        pyplot.show()


if __name__ == "__main__":
    main()
