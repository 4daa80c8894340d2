"""The experiments behind docs/results/papers.md: commands, what they read, what is taken from them. For
scripts/results."""
import statistics

from kept import Experiment
from papers_measures import (board_tables, followed, gains, kernels, lens_figures, moment_figures, times_of_frames,
                             tracked)
from papers_rows import AS_THE_PAPER, FILMS, OFFSETS, TABLE_6, TOWN_WINDOWS, window_name

BENCHMARKS = ["bundle_growth_benchmark", "pless_benchmark", "tracker_benchmark", "ifba_benchmark",
              "lens_boards_benchmark"]
# Recipes and flags of the films. Noise, and exposure: as in the recipe of the street.
REAL = ["--noise", "3", "--blur", "0.01", "--samples", "1"]
RENDERED = {"street": ("lba09-5-street", []), "pinhole": ("lba09-1-pinhole", REAL), "stereo": ("lba09-3-stereo", REAL),
            "mirror": ("lba09-2-mirror", REAL), "town": ("lba09-5-town", []),
            "town-quick": ("lba09-5-town", ["--frames", "725"])}
FOUND = ["kitti07-mono"]  # below the shared data
QUICK_TRIALS, QUICK_SEEDS = 100, 4
CHECKED = ["kitti07-mono global", "kitti07-mono", "kitti07-mono paper global", window_name("kitti07-mono", 3, 3),
           window_name("kitti07-mono", 3, 10), "kitti07-mono generic"]  # of --check


def track(film, *flags):
    return ["{raysfm}", "track", f"{{{film}}}", "--out", "{out}/o", "--threads", "1", "--quiet", *flags]


def judge(estimate, truth):
    return ["{raysfm}", "eval", estimate, truth, "--align", "sim3", "--json"]


def track_experiment(name, film, *flags, against="", measure=tracked, **more):
    """A run judged by its key frames against the truth, and by its trajectory against the one named."""
    commands = [track(film, *flags), judge("{out}/o/keyframes.txt", f"{{{film}}}/truth.txt")]
    inputs = [film]
    if against:
        commands.append(judge("{out}/o/trajectory.txt", f"{{{against}}}"))
        inputs.append(against)
    if measure is followed:
        commands.append(["cat", f"{{{film}}}/truth.txt"])
    return Experiment(name, commands, measure, ["raysfm"], inputs, may_fail=True, **more)


def global_experiment(film, *flags):
    leaf = f"{film}-global"
    return track_experiment(f"{film} global", film, "--final", "global", *flags, leaves={leaf: "o/trajectory.txt"})


def times(film):
    return Experiment(f"{film} times", [["{tracker_benchmark}", f"{{{film}}}", "--frames", "{out}/frames.csv"]],
                      times_of_frames, ["tracker_benchmark"], [film])


def windows(film):
    """Tables 4 to 6: windows as LBA09 2.5 has them."""
    yield track_experiment(f"{film} paper global", film, *AS_THE_PAPER, "--final", "global",
                           leaves={f"{film}-paper-global": "o/trajectory.txt"})
    for n in TABLE_6:
        for offset in OFFSETS if n <= 4 else (2, 7):
            yield track_experiment(window_name(film, n, n + offset), film, "--paper-window", *AS_THE_PAPER, "--free-cameras",
                                   str(n), "--window", str(n + offset), against=f"{film}-paper-global")


def perspective(film):
    yield global_experiment(film)
    yield track_experiment(film, film, against=f"{film}-global", measure=followed)
    yield track_experiment(f"{film} generic", film, "--error", "angular-plain", against=f"{film}-global",
                           measure=followed)
    yield times(film)


def generic(film):
    """6.2: angles between rays, against everything adjusted by pixels where the camera projects."""
    by_angles = [] if film == "mirror" else ["--error", "angular"]
    yield global_experiment(film, *(["--mono"] if film == "stereo" else []))
    yield track_experiment(film, film, *by_angles, against=f"{film}-global", measure=followed)
    yield times(film)


def town(quick):
    film = "town-quick" if quick else "town"
    scale = "725 of 2900 frames" if quick else ""
    yield track_experiment("town global", film, "--final", "global", leaves={f"{film}-global": "o/trajectory.txt"},
                           scale=scale)
    for n, window in TOWN_WINDOWS:
        yield track_experiment(window_name("town", n, window), film, "--paper-window", *AS_THE_PAPER, "--free-cameras",
                               str(n), "--window", str(window), against=f"{film}-global", scale=scale)
    yield track_experiment("town", film, against=f"{film}-global", measure=followed, scale=scale)


def lenses(quick):
    trials = str(QUICK_TRIALS if quick else 1000)
    scale = f"{QUICK_TRIALS} of 1000 trials" if quick else ""
    yield Experiment("moments", [["{ifba_benchmark}", "--trials", "1000", "--figure", "2", "--seed", "1"]], moment_figures,
                     ["ifba_benchmark"])  # ten samples for each trial, as many as in the paper
    for name, figure in (("fixed lens", "5"), ("zooming lens", "8"), ("principal point", "11"), ("zooming cameras", "12")):
        yield Experiment(name, [["{ifba_benchmark}", "--trials", trials, "--figure", figure, "--seed", "1"]], lens_figures,
                         ["ifba_benchmark"], scale=scale)
    yield Experiment("boards", [["{lens_boards_benchmark}", str(QUICK_SEEDS if quick else 20)]], board_tables,
                     ["lens_boards_benchmark"], scale=f"{QUICK_SEEDS} of 20 seeds" if quick else "")


def experiments(quick):
    """All of them, those that others need before these, short ones first. The quick ones leave out what their `scale`
    says."""
    found = [Experiment("growth", [["{bundle_growth_benchmark}", "0"]], gains, ["bundle_growth_benchmark"]),
             Experiment("kernel", [["{pless_benchmark}", "1000"]], kernels, ["pless_benchmark"])]
    for film in reversed(FILMS):
        found += perspective(film)
    for film in reversed(FILMS):
        found += windows(film)
        found.append(track_experiment(f"{film} calibration as given", film, *AS_THE_PAPER[:2]))
    for film in ("pinhole", "stereo", "mirror"):
        found += generic(film)
    return found + [*lenses(quick), *town(quick)]


def derived(results):
    """What follows from several results: {name: (result, names of the experiments)}."""
    found = {}
    for film in FILMS:
        for n in TABLE_6:
            names = [window_name(film, n, n + offset) for offset in OFFSETS if offset > 1]
            names = [name for name in names if "adjust_ms" in results.get(name, {})]
            if names:
                mean = statistics.fmean(results[name]["adjust_ms"] for name in names)
                found[f"{film} adjust n={n}"] = ({"adjust_s": mean / 1000}, names)
        pair = [f"{film} calibration as given", f"{film} generic"]  # plain angles refine no calibration
        if all("mean_m" in results.get(name, {}) for name in pair):
            found[f"{film} by angles"] = ({"over_pixels": results[pair[1]]["mean_m"] / results[film]["mean_m"]}, pair)
    return found


def paths(program, benchmarks, data, films, kept_folder):
    """Where each {NAME} of the commands is."""
    found = {"raysfm": program} | {name: benchmarks / name for name in BENCHMARKS}
    found |= {name: data / name for name in FOUND} | {name: films / name for name in RENDERED}
    left = [f"{film}-{kind}" for film in [*FOUND, *RENDERED] for kind in ("global", "paper-global")]
    return found | {name: kept_folder / f"{name}.txt" for name in left}
