"""What each departure from LBA09 brings: docs/results/departures.md, made by scripts/results."""
import math
import statistics

# Real and rendered, perspective and not, sharp and blurred; below the shared data.
SEQUENCES = [dict(name="kitti07-mono"), dict(name="tsukuba-mono"), dict(name="redkitchen-handheld"), dict(name="fr1-rpy"),
             dict(name="kitti06-stereo"), dict(name="rendered/fisheye190"), dict(name="rendered/mirror"), dict(name="rendered/tri-rig")]
# docs/architecture.md says what they are.
SETTINGS = {
    "as it comes": [],
    "without blur": ["--without", "blur"],
    "without earlier": ["--without", "earlier"],
    "without keyframes": ["--without", "keyframes"],
    "without noise": ["--without", "noise"],
    "without parallax": ["--without", "parallax"],
    "without surfaces": ["--without", "surfaces"],
    "without turning": ["--without", "turning"],
    "the calibration as given": ["--refine-lens", "off"],
    "no loops": ["--loops", "off"],
    "no rolling shutter": ["--rolling-shutter", "none"],
    "the window of the paper": ["--paper-window"],
    "plain angles": ["--error", "angular-plain"],
    "17 points to start": ["--start", "pless"],
    "as the paper": ["--preset", "lba09"],
}
SEEDS = 3


def cell(results):
    """Medians over the seeds: error in % of the path, ms a frame, and the frames posed where some are not."""
    found = [r for r in results if r and r.get("eval")]
    if not found:
        return "no pose"
    median = lambda value: statistics.median(value(r) for r in found)
    error = median(lambda r: 100 * r["eval"]["ate"]["mean"] / r["eval"]["length_m"])
    time = median(lambda r: r["report"]["timing"]["frame"]["mean_ms"])
    posed = median(lambda r: 100 * r["report"]["frames"]["posed"] / r["report"]["frames"]["total"])
    rest = "" if posed == 100 else f", {math.floor(posed)} % posed"
    return f"{error:.3f} %, {time:.1f} ms{rest}"


def rows(track_once):
    """Lines of the table. `track_once(sequence, seed)`: of scripts/results; None where the sequence is missing."""
    for name, flags in SETTINGS.items():
        cells = [cell([track_once(dict(sequence, flags=flags), seed) for seed in range(SEEDS)]) for sequence in SEQUENCES]
        yield f"| {name} | " + " | ".join(cells) + " |"


def write_table(path, made_by, lines):
    names = [sequence["name"] for sequence in SEQUENCES]
    text = ["# What departures from the paper bring", "",
            f"{made_by} Mean ATE in % of the path after alignment by a similarity, and the time of a frame after decoding; medians over {SEEDS} seeds. "
            "Each line changes one thing, the last one all of them but the start: docs/architecture.md says what the departures are. Equal figures are "
            "equal bytes as a rule: blur, turns, loops and rolling shutters matter only where there are any.", "",
            "| | " + " | ".join(names) + " |", "|---" * (len(names) + 1) + "|", *lines, ""]
    path.write_text("\n".join(text))
