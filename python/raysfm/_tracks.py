"""Point tracks in arrays.

What this needs is imported where it is needed: numpy and its types take longer to load than the rest of the package,
and who tracks a file may never use an array.
"""
from __future__ import annotations

from ._raysfm import Run, solve

TYPE_CHECKING = False  # true for whoever checks types, without the time that `typing` takes
if TYPE_CHECKING:
    from typing import Any

    from numpy.typing import ArrayLike, NDArray


def solve_tracks(images: ArrayLike, points: ArrayLike, pixels: ArrayLike, *, size: tuple[int, int],
                 structure: ArrayLike | None = None, **options: Any) -> Run:
    """Unknown or zooming lens from point tracks: point points[k] is seen in image images[k] at pixels[k].

    `images` and `points` are (n,) whole numbers, `pixels` is (n, 2), `size` the (width, height) of the images.
    `structure`, where positions are known, is an array (m, 3) that points[k] is an index into. Else as solve().
    """
    import pathlib
    import tempfile

    image, point = _whole(images, "images"), _whole(points, "points")
    pixel = _real(pixels, "pixels", 2)
    if not len(image) == len(point) == len(pixel):
        raise ValueError(f"images, points and pixels: {len(image)}, {len(point)} and {len(pixel)} entries; as many are needed")
    with tempfile.TemporaryDirectory(prefix="raysfm-") as folder:
        tracks = pathlib.Path(folder) / "tracks.csv"
        rows = (f"{i},{p},{u!r},{v!r}\n" for i, p, (u, v) in zip(image.tolist(), point.tolist(), pixel.tolist()))
        tracks.write_text("image,point,u,v\n" + "".join(rows))
        if structure is not None:
            known = pathlib.Path(folder) / "structure.csv"
            positions = _real(structure, "structure", 3).tolist()
            known.write_text("point,x,y,z\n" + "".join(f"{i},{x!r},{y!r},{z!r}\n" for i, (x, y, z) in enumerate(positions)))
            options["structure"] = known
        width, height = (int(side) for side in size)
        return solve(tracks, size=f"{width}x{height}", **options)


def _whole(values: ArrayLike, name: str) -> NDArray[Any]:
    import numpy

    array = numpy.asarray(values)
    if array.dtype.kind not in "iu":
        raise TypeError(f"{name}: dtype {array.dtype} is not allowed, whole numbers are")
    if array.ndim != 1:
        raise ValueError(f"{name}: shape {array.shape} is not allowed, (n,) is")
    return array


def _real(values: ArrayLike, name: str, columns: int) -> NDArray[Any]:
    import numpy

    array = numpy.asarray(values)
    if array.dtype.kind not in "iuf":
        raise TypeError(f"{name}: dtype {array.dtype} is not allowed, real numbers are")
    if array.ndim != 2 or array.shape[1] != columns:
        raise ValueError(f"{name}: shape {array.shape} is not allowed, (n, {columns}) is")
    return array.astype(float)
