"""Makes footage harder: python3 scripts/degrade.py SEQUENCE OUT --kind KIND --strength S [--frames N] [--seed N]

SEQUENCE is a folder of images/ (or image_0/) with times.txt, camera.yaml and truth.txt; OUT becomes another one, grey.
The kinds and what their strength means are in KINDS. Needs numpy and Pillow (of Debian: python3-numpy, python3-pil).
"""
import argparse
import io
import pathlib
import shutil

import numpy
from PIL import Image, ImageDraw

BURST_EVERY, BURST_LENGTH = 30, 8  # frames
# What a bright surface gives before noise: electrons in a sensor's pixel, and its noise of reading.
FULL_WELL, READ_NOISE = 4000.0, 8.0


def blurred(image, length, angle):
    """The mean over a straight line of so many pixels, as a shutter leaves it that is open while the image moves: of
    places at most half a pixel apart, their number doubled until it is enough."""
    doublings = max(1, int(numpy.ceil(numpy.log2(2 * length))))
    for step in length / 2.0 ** numpy.arange(1, doublings + 1):
        x, y = 0.5 * step * numpy.cos(angle), 0.5 * step * numpy.sin(angle)
        image = 0.5 * (shifted(image, x, y) + shifted(image, -x, -y))
    return image


def shifted(image, x, y):
    """Bilinear; the border is repeated."""
    for axis, by in ((1, x), (0, y)):
        whole, rest = int(numpy.floor(by)), by - numpy.floor(by)
        index = numpy.arange(image.shape[axis])
        take = lambda step: numpy.take(image, numpy.clip(index - whole - step, 0, image.shape[axis] - 1), axis)
        image = (1 - rest) * take(0) + rest * take(1)
    return image


def texture(random, height, width, finest=3):
    """Grey patches of several sizes with edges: as much for a corner detector as a wall of posters."""
    image = numpy.zeros((height, width))
    for cell in (finest, 3 * finest, 9 * finest):
        grid = random.uniform(-1, 1, (height // cell + 2, width // cell + 2))
        image += numpy.kron(grid, numpy.ones((cell, cell)))[:height, :width]
    return numpy.clip(127 + 40 * image, 0, 255)


class Nothing:
    """A kind: what it needs is drawn once, then `apply` takes image after image (floats from 0 to 255)."""

    def __init__(self, strength, random, frames, first):
        self.strength, self.random, self.frames, self.first = strength, random, frames, first
        self.height, self.width = first.shape
        self.prepare()

    def own_texture(self):
        """As many and as strong corners as the film has: its first image upside down, mirrored at its borders."""
        wide = numpy.concatenate([self.first, self.first[:, ::-1]] * 2, axis=1)
        return numpy.concatenate([wide[::-1], wide], axis=0)

    def prepare(self):
        pass

    def keeps(self, frame):
        return True

    def apply(self, frame, image):
        return image


class Blur(Nothing):
    def apply(self, frame, image):
        angle = 0.6 * numpy.sin(frame / 17)  # the hand turns slowly
        return blurred(image, self.strength / 100 * self.width, angle)


class BlurBursts(Blur):
    def apply(self, frame, image):
        return super().apply(frame, image) if frame % BURST_EVERY >= BURST_EVERY - BURST_LENGTH else image


class Darkness(Nothing):
    """Light becomes less by a factor: electrons are counted, read with noise, quantised to 8 bits."""

    def apply(self, frame, image):
        electrons = self.random.poisson(image / 255 / self.strength * FULL_WELL)
        read = electrons + READ_NOISE * self.random.standard_normal(image.shape)
        return read / FULL_WELL * 255


class Exposure(Nothing):
    """Gain goes up or down by a factor from one frame to the next, every ten frames."""

    def apply(self, frame, image):
        gain = self.strength ** (0.5 if (frame // 10) % 2 else -0.5)
        return image * gain


class Walkers(Nothing):
    """Figures of the image's height that walk across, each its own way; their part of the image is the strength in %."""

    def prepare(self):
        self.count = 6
        self.breadth = self.strength / 100 * self.width * 1.5 / self.count  # the way is longer than the image is wide
        self.speed = self.random.uniform(0.004, 0.012, self.count) * self.width
        self.speed *= numpy.where(self.random.uniform(size=self.count) < 0.5, -1, 1)
        self.start = (numpy.arange(self.count) + 0.5) / self.count * 1.5 * self.width
        self.paint = [self.texture() for _ in range(self.count)]

    def texture(self):
        left = int(self.random.integers(self.width))
        return self.own_texture()[:self.height, left:left + int(self.breadth) + 2]

    def apply(self, frame, image):
        image = image.copy()
        for k in range(self.count):
            left = (self.start[k] + frame * self.speed[k]) % (1.5 * self.width) - 0.25 * self.width
            paste(image, self.paint[k], left, 0, self.breadth, self.height)
        return image


class Posters(Walkers):
    """The same with a texture that has far more corners than the film."""

    def texture(self):
        return texture(self.random, self.height, int(self.breadth) + 2)


class Vehicle(Nothing):
    """One wall, as a bus beside the camera: its part of the image is the strength in %. It comes in from the
    right, stays, moving to and fro, and grows and shrinks a little."""

    def prepare(self):
        self.paint = self.own_texture()

    def apply(self, frame, image):
        image = image.copy()
        side = numpy.sqrt(self.strength / 100)
        size = 1 + 0.1 * numpy.sin(frame / 23)
        wide, high = side * self.width * size, side * self.height * size
        enter = max(0.0, 1 - frame / 20) * self.width
        left = 0.5 * (self.width - wide) + 0.12 * self.width * numpy.sin(frame / 15) + enter
        paste(image, self.paint, left, 0.5 * (self.height - high), wide, high, size)
        return image


def paste(image, paint, left, top, wide, high, scale=1.0):
    """A piece of paint with its corner at (left, top), bilinear, cut at the border of the image."""
    x0, x1 = max(0, int(numpy.ceil(left))), min(image.shape[1], int(numpy.floor(left + wide)))
    y0, y1 = max(0, int(numpy.ceil(top))), min(image.shape[0], int(numpy.floor(top + high)))
    if x0 >= x1 or y0 >= y1:
        return
    x, y = (numpy.arange(x0, x1) - left) / scale, (numpy.arange(y0, y1) - top) / scale
    i, j = numpy.floor(y).astype(int), numpy.floor(x).astype(int)
    i, j = numpy.minimum(i, paint.shape[0] - 2), numpy.minimum(j, paint.shape[1] - 2)
    v, u = (y - i)[:, None], (x - j)[None, :]
    pick = lambda a, b: paint[numpy.ix_(i + a, j + b)]
    image[y0:y1, x0:x1] = ((1 - v) * ((1 - u) * pick(0, 0) + u * pick(0, 1)) +
                           v * ((1 - u) * pick(1, 0) + u * pick(1, 1)))


class Rain(Nothing):
    """Bright streaks that fall, so many in each frame."""

    def apply(self, frame, image):
        layer = Image.new("L", (self.width, self.height), 0)
        draw = ImageDraw.Draw(layer)
        for _ in range(int(self.strength)):
            x, y = self.random.uniform(0, self.width), self.random.uniform(-0.1, 1) * self.height
            long = self.random.uniform(0.04, 0.12) * self.height
            draw.line((x, y, x + 0.15 * long, y + long), fill=int(self.random.uniform(60, 160)),
                      width=1 + int(self.random.uniform() < 0.3))
        rain = numpy.asarray(layer, dtype=float) / 255
        return image * (1 - rain) + 230 * rain


class Textureless(Nothing):
    """A stretch in the middle where contrast is gone but for a 50th, as before a white wall or in fog; the strength is
    its length in % of the frames."""

    def apply(self, frame, image):
        middle, half = 0.6 * self.frames, 0.005 * self.strength * self.frames
        return 128 + (image - 128) / 50 if abs(frame - middle) < half else image


class Dropped(Nothing):
    """One frame in so many is kept, with its time."""

    def keeps(self, frame):
        return frame % int(self.strength) == 0


class Noise(Nothing):
    def apply(self, frame, image):
        return image + self.strength * self.random.standard_normal(image.shape)


class Jpeg(Nothing):
    def apply(self, frame, image):
        memory = io.BytesIO()
        to_image(image).save(memory, "JPEG", quality=int(self.strength))
        return numpy.asarray(Image.open(memory), dtype=float)


KINDS = {"none": Nothing, "blur": Blur, "blur-bursts": BlurBursts, "darkness": Darkness, "exposure": Exposure,
         "walkers": Walkers, "posters": Posters, "vehicle": Vehicle, "rain": Rain, "textureless": Textureless, "dropped": Dropped,
         "noise": Noise, "jpeg": Jpeg}


def grey(path):
    return numpy.asarray(Image.open(path).convert("L"), dtype=float)


def to_image(values):
    return Image.fromarray(numpy.clip(numpy.rint(values), 0, 255).astype(numpy.uint8))


def degrade(source, out, kind, strength, frames, seed):
    images = sorted(next(source / name for name in ("images", "image_0") if (source / name).is_dir()).iterdir())
    images = images[:frames or None]
    times = (source / "times.txt").read_text().split()
    random = numpy.random.default_rng([seed, *kind.encode()])
    change = KINDS[kind](strength, random, len(images), grey(images[0]))
    (out / "images").mkdir(parents=True, exist_ok=True)
    kept = []
    for frame, path in enumerate(images):
        if not change.keeps(frame):
            continue
        to_image(change.apply(frame, grey(path))).save(out / "images" / f"{frame:06d}.png", compress_level=1)
        kept.append(times[frame])
    (out / "times.txt").write_text("\n".join(kept) + "\n")
    for name in ("camera.yaml", "truth.txt"):
        shutil.copy(source / name, out)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--kind", choices=KINDS, required=True)
    parser.add_argument("--strength", type=float, default=0)
    parser.add_argument("--frames", type=int, default=0, help="from the beginning; 0: all")
    parser.add_argument("--seed", type=int, default=0)
    a = parser.parse_args()
    degrade(a.source, a.out, a.kind, a.strength, a.frames, a.seed)


if __name__ == "__main__":
    main()
