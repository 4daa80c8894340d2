"""The figures of the two papers drawn from kept experiments. For scripts/results."""
import math

from charts import chart

METHODS = ("standard", "free", "squares", "polished")


def level(points):
    """To the right and forward."""
    return [p[0] for p in points], [p[2] for p in points]


def way(places):
    """Metres from the first place to each."""
    found = [0.0]
    for a, b in zip(places, places[1:]):
        found.append(found[-1] + math.dist(a, b))
    return found


def times(result):
    frames = range(len(result["seconds"]))
    of = {kind: [i for i in frames if result["is_keyframe"][i] == kind] for kind in (0, 1)}
    return chart([("other frames", "dots", of[0], [1000 * result["seconds"][i] for i in of[0]]),
                  ("key frames", "dots", of[1], [1000 * result["seconds"][i] for i in of[1]])], "frame", "ms")


def top_view(result):
    return chart([("points", "specks", *level(result["map"])), ("key frames", "dots", *level(result["places"]))],
                 "m to the right", "m forward", equal=True)


def registration(result):
    return chart([("truth", "line", *level(result["truth"])), ("key frames", "dots", *level(result["places"]))],
                 "m to the right", "m forward", equal=True)


def heights(result):
    return chart([("truth", "line", way(result["truth"]), [-p[1] for p in result["truth"]]),
                  ("key frames", "dots", way(result["places"]), [-p[1] for p in result["places"]])],
                 "m along the path", "m of height", height=200, from_zero=False)


def errors(result):
    along = way(result["places"])
    return chart([("2D", "line", along, result["error_2d"]), ("3D", "line", along, result["error_3d"])],
                 "m along the path", "m")


def lengths(result):
    images, points = zip(*result["track_lengths"])
    return chart([("", "bars", images, points)], "key frames that see a point", "points")


def of_methods(table, quantity, title):
    return chart([(m, "line", table["x"], table[f"{m} {quantity}"]) for m in METHODS], table["axis"], title)


def of_moments(table, part, title):
    names = [name for name in table if name not in ("x", "axis")]
    return chart([(name, "line", table["x"], [pair[part] for pair in table[name]]) for name in names], table["axis"], title)


def of_films():
    """(paper, item), file, what it shows, experiment, function."""
    for film in ("street", "kitti07-mono"):
        yield ("LBA09", "Figure 10"), f"lba09-10-{film}", "Time of each frame", f"{film} times", times
        for number, name, text, draw in ((11, "11", "Map from above", top_view), (12, "12-level", "Registration from above", registration),
                                         (12, "12-height", "Registration of the height", heights),
                                         (13, "13", "Error along the path", errors), (14, "14", "Lengths of tracks", lengths)):
            yield ("LBA09", f"Figure {number}"), f"lba09-{name}-{film}", text, film, draw
        yield ("LBA09", "Figure 17"), f"lba09-17-level-{film}", "Registration by angles", f"{film} generic", registration
        yield ("LBA09", "Figure 17"), f"lba09-17-{film}", "Error along the path by angles", f"{film} generic", errors
    yield ("LBA09", "Figure 15"), "lba09-15", "Map of the town", "town", top_view
    for film in ("mirror", "stereo"):
        yield ("LBA09", "Figure 18"), f"lba09-18-{film}", f"Map of {film}", film, top_view


def of_lenses():
    quantities = (("cpu", "CPU ms", 0), ("iterations", "iterations", 0), ("structure", "structure error, mm", 1),
                  ("focal", "focal error, %", 2))
    for first, experiment in ((5, "fixed lens"), (8, "zooming lens")):
        for quantity, title, offset in quantities:
            for kind in ("noise px", "images"):
                yield (("IFBA01", f"Figure {first + offset}"), f"ifba01-{first + offset}-{quantity}-{kind.split()[0]}", title, experiment,
                       lambda r, k=kind, q=quantity, t=title: of_methods(r[k], q, t))
    yield (("IFBA01", "Figure 11"), "ifba01-11", "CPU ms", "principal point", lambda r: of_methods(r["std px"], "cpu", "CPU ms"))
    for kind in ("rigid", "deforming"):
        for number, quantity, title in ((12, "cpu", "CPU ms"), (13, "structure", "structure error, mm")):
            yield (("IFBA01", f"Figure {number}"), f"ifba01-{number}-{kind}", f"{title}, {kind}", "zooming cameras",
                   lambda r, k=kind, q=quantity, t=title: of_methods(r[k], q, t))
    for number, table in ((2, "Q"), (3, "K"), (4, "K of points")):
        for part, title in ((0, "mean relative error, %"), (1, "standard deviation, %")):
            yield (("IFBA01", f"Figure {number}"), f"ifba01-{number}-{('mean', 'deviation')[part]}", title, "moments",
                   lambda r, k=table, p=part, t=title: of_moments(r[k], p, t))


def draw(records, folder):
    """Writes the charts of what there is; returns {(paper, item): [(file, what it shows)]}."""
    drawn = {}
    for item, name, text, experiment, function in [*of_films(), *of_lenses()]:
        record = records.get(experiment)
        if record is None or "failed" in record["result"]:
            continue
        (folder / f"{name}.svg").write_text(function(record["result"]))
        drawn.setdefault(item, []).append((f"{name}.svg", text))
    return drawn
