"""Charts as SVG, without any library. For scripts/results."""
import math

COLOURS = ["#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#7f7f7f"]
LEFT, RIGHT, TOP, BOTTOM = 52, 12, 24, 36


def tick_step(span):
    """The step of about four ticks over a range: 1, 2, 2.5 or 5 times a power of ten."""
    rough = span / 4 or 1
    power = 10.0 ** math.floor(math.log10(rough))
    return next((factor * power for factor in (1, 2, 2.5, 5) if factor * power >= 0.999 * rough), 10 * power)


def extent(values, from_zero):
    values = [v for v in values if math.isfinite(v)] or [0.0, 1.0]
    low, high = min(values), max(values)
    low = min(low, 0.0) if from_zero else low
    return (low, high) if high > low else (low, low + 1)


def compact(number):
    return f"{number:.1f}".rstrip("0").rstrip(".")


def marks(series, at, colour):
    """The drawing of one series: a line, dots, or bars down to zero."""
    _, style, xs, ys = series
    places = [at(x, y) for x, y in zip(xs, ys) if math.isfinite(x) and math.isfinite(y)]
    if style == "line":
        path = "M" + "L".join(f"{compact(x)} {compact(y)}" for x, y in places)
        return f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="1.3"/>'
    if style == "bars":
        path = "".join(f"M{compact(at(x, 0)[0])} {compact(at(x, 0)[1])}V{compact(at(x, y)[1])}" for x, y in zip(xs, ys))
        return f'<path d="{path}" stroke="{colour}" stroke-width="5"/>'
    size = 1 if style == "specks" else 3
    path = "".join(f"M{compact(x)} {compact(y)}h0" for x, y in places)
    return f'<path d="{path}" stroke="{colour}" stroke-width="{size}" stroke-linecap="round"/>'


def frame(x_range, y_range, at, width, height, titles):
    parts = [f'<rect width="{width}" height="{height}" fill="white"/>']
    for low, high, is_x in ((*x_range, True), (*y_range, False)):
        step = tick_step(high - low)
        for i in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1):
            x, y = at(i * step, y_range[0]) if is_x else at(x_range[0], i * step)
            line = f"V{TOP}" if is_x else f"H{width - RIGHT}"
            parts.append(f'<path d="M{compact(x)} {compact(y)}{line}" stroke="#ddd"/>')
            where = f'x="{compact(x)}" y="{compact(y + 13)}" text-anchor="middle"' if is_x else \
                f'x="{compact(x - 5)}" y="{compact(y + 4)}" text-anchor="end"'
            parts.append(f"<text {where}>{i * step:.4g}</text>")
    parts.append(f'<text x="{width / 2}" y="{height - 6}" text-anchor="middle">{titles[0]}</text>')
    parts.append(f'<text x="4" y="14">{titles[1]}</text>')
    return parts


def chart(series, x_title, y_title, width=520, height=300, equal=False, from_zero=True):
    """`series` are (name, "line", "dots", "specks" or "bars", xs, ys); `equal`: a map, with one scale for both axes."""
    x_range = extent([x for s in series for x in s[2]], False)
    y_range = extent([y for s in series for y in s[3]], from_zero and not equal)
    if equal:
        scale = (width - LEFT - RIGHT) / (x_range[1] - x_range[0])
        height = round(min(max(scale * (y_range[1] - y_range[0]), 60), 420)) + TOP + BOTTOM
        scale = min(scale, (height - TOP - BOTTOM) / (y_range[1] - y_range[0]))
        scales = (scale, scale)
    else:
        scales = ((width - LEFT - RIGHT) / (x_range[1] - x_range[0]), (height - TOP - BOTTOM) / (y_range[1] - y_range[0]))

    def at(x, y):
        return LEFT + scales[0] * (x - x_range[0]), height - BOTTOM - scales[1] * (y - y_range[0])

    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" font-family="sans-serif" '
             'font-size="11">', *frame(x_range, y_range, at, width, height, (x_title, y_title))]
    place = 150
    for number, one in enumerate(series):
        colour = COLOURS[number % len(COLOURS)]
        parts.append(marks(one, at, colour))
        if one[0]:
            parts.append(f'<text x="{place}" y="14" fill="{colour}">{one[0]}</text>')
            place += 16 + 7 * len(one[0])
    return "\n".join(parts + ["</svg>", ""])
