"""Two looks at one sequence that share no pixel: for scripts/covariance.py.

  halves.py masks SEQUENCE FOLDER   half0.yaml, half1.yaml: the sequence's camera, seeing one or the other fields of a chessboard
  halves.py double IN.csv OUT.csv   covariances of the difference of two estimates that are as good as one another
"""
import pathlib
import re
import struct
import sys
import zlib

FIELD = 64  # pixels: large beside a patch


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def chessboard(width, height, first):
    """A PNG whose fields are 255 and 0 in turn; `first`: whether the one at the origin is 255."""
    colours = [b"\xff" * FIELD, b"\0" * FIELD]
    rows = []
    for parity in (0, 1):
        fields = [colours[(column + parity + (not first)) % 2] for column in range(width // FIELD + 1)]
        rows.append(b"\0" + b"".join(fields)[:width])
    pixels = b"".join(rows[y // FIELD % 2] for y in range(height))
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(pixels)) + chunk(b"IEND", b"")


def write_masks(sequence, folder):
    given = (sequence / "camera.yaml").read_text()
    width, height = map(int, re.search(r"resolution:\s*\[(\d+),\s*(\d+)\]", given).groups())
    for half in (0, 1):
        mask = folder / f"half{half}.png"
        mask.write_bytes(chessboard(width, height, half == 0))
        text = re.sub(r"^(\s*)(resolution:.*)$", rf"\1\2\n\1mask: {mask}", given, flags=re.MULTILINE)
        (folder / f"half{half}.yaml").write_text(text)


def double(source, target):
    lines = []
    for line in source.read_text().splitlines():
        time, _, numbers = line.partition(",")
        is_row = re.match(r"[-+.\d]", line)
        lines.append(f"{time}," + ",".join(repr(2 * float(x)) for x in numbers.split(",")) if is_row else line)
    target.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    what, first, second = sys.argv[1], pathlib.Path(sys.argv[2]), pathlib.Path(sys.argv[3])
    write_masks(first, second) if what == "masks" else double(first, second)
