"""The page docs/results/papers.md from rows and kept experiments. For scripts/results."""
import math

import papers_charts
from papers_rows import NOTES, PAPERS

TITLES = {"LBA09": "LBA09: Generic and Real Time Structure from Motion using Local Bundle Adjustment (2009)",
          "IFBA01": "IFBA01: Euclidean Bundle Adjustment Independent on Camera Intrinsic Parameters (2001)"}


def value_of(row, record):
    """Ours: a number, or a text where the run failed or the result is one."""
    result = record["result"]
    if "failed" in result:
        return result["failed"]
    try:
        return row.ours(result) if callable(row.ours) else result[row.ours]
    except (KeyError, ValueError, IndexError, ZeroDivisionError):
        return "no value"


def shown(value, unit=""):
    if value is None:
        return "-"
    if isinstance(value, str):
        return value
    if isinstance(value, float) and not math.isfinite(value):
        return "no value"
    text = str(value) if isinstance(value, int) else f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
    return f"{text} {unit}".strip()


def is_number(value):
    return isinstance(value, (int, float)) and math.isfinite(value)


def cells_of(row, records):
    if row.none:
        return [row.what, shown(row.paper), "not reproduced", "-", row.none]
    record = records.get(row.experiment)
    if record is None:
        return [row.what, shown(row.paper, row.unit), "not yet run", "-", row.experiment]
    ours = value_of(row, record)
    ratio = shown(ours / row.paper) if is_number(ours) and is_number(row.paper) and row.paper else "-"
    scale = f" ({record['scale']})" if record["scale"] else ""
    return [row.what, shown(row.paper, row.unit), shown(ours, row.unit), ratio, row.experiment + scale]


def section(item, rows, records, pictures, note):
    lines = [f"### {item}", "", "| what | paper | ours | ours/paper | experiment |", "|---|---|---|---|---|"]
    lines += ["| " + " | ".join(cells_of(row, records)) + " |" for row in rows] + [""]
    lines += [note, ""] if note else []
    for name, text in pictures:
        lines += [f"![{text}](../images/papers/{name})", ""]
    return lines


def unmeasured(items):
    """The items that have no experiment at all, in one table."""
    lines = ["### Drawings and photos", "", "| | what | ours | why |", "|---|---|---|---|"]
    return lines + [f"| {row.item} | {row.what} | not reproduced | {row.none} |" for rows in items for row in rows] + [""]


def experiment_table(records):
    lines = ["## The experiments", "", "The load is that of the machine in the last minute: above the number of its cores, times are not its own.", "",
             "| experiment | commands | seconds | load | made |", "|---|---|---|---|---|"]
    for name, record in records.items():
        if "parts" in record:
            lines.append(f"| {name} | mean or ratio of {', '.join(record['parts'])} | | | |")
            continue
        commands = "<br>".join(f"`{command}`" for command in record["commands"])
        lines.append(f"| {name} | {commands} | {record['seconds']} | {record['load']} | {record['made']} |")
    return lines + [""]


def introduction(made_by, missing, minutes):
    lines = [
        "# The two papers, row by row", "",
        f"Made by `scripts/results papers`: {made_by}. Seed 0 of `track`, seed 1 of the benchmarks, one thread. Nothing here is "
        "typed by hand but the papers' own figures (`scripts/papers_rows.py`). The commands of each experiment are in the "
        f"last table; they took {minutes:.0f} minutes, without the rendering. Words without a path are programs and inputs, `out` a folder for the occasion.", "",
        "`street`, `town`, `pinhole`, `mirror` and `stereo` are rendered twins of the papers' sequences (`scripts/recipes/lba09-*`): "
        "same length, number of frames and size of images, other pictures, with noise of 3 grey levels, an exposure of 10 ms, and "
        "people walking in the street. `kitti07-mono` is real: 54 m in 100 frames of a car, faster and larger than the paper's. "
        "Errors are means over key frames after alignment by a similarity. The plane of 2D errors is level.", "",
        "Tables 4 to 6 run with `--paper-window`, since `track` by itself refuses N < n + 2 and holds older key frames that share points "
        "with the window, and without what adjusts the map once more and would hide what a window does: refined calibrations and loops. "
        "A run counts as failed when fewer than 95 % of its frames have a pose in one world.", ""]
    if missing:
        lines += [f"Not yet run: {', '.join(missing)}.", ""]
    return lines


def write(path, pictures_folder, records, made_by, names):
    """Writes the page and its charts; returns how many rows it has of which kind, as a text."""
    pictures = papers_charts.draw(records, pictures_folder)
    lines = introduction(made_by, [name for name in names if name not in records],
                         sum(record.get("seconds", 0) for record in records.values()) / 60)
    counts = {"rows": 0, "not yet run": 0, "not reproduced": 0}
    for paper, items in PAPERS.items():
        lines += [f"## {TITLES[paper]}", ""]
        for item, rows in items().items():
            if any(row.experiment for row in rows):
                lines += section(item, rows, records, pictures.get((paper, item), []),
                                 NOTES.get((paper, item)))
            counts["rows"] += len(rows)
            counts["not reproduced"] += sum(bool(row.none) for row in rows)
            counts["not yet run"] += sum(not row.none and row.experiment not in records for row in rows)
        lines += unmeasured([rows for rows in items().values() if not any(row.experiment for row in rows)])
    lines += experiment_table(records)
    path.write_text("\n".join(lines))
    return ", ".join(f"{count} {what}" for what, count in counts.items())
