"""Every table and figure of the two papers beside what raysfm gives: docs/results/papers.md, made by scripts/results.

Experiments are kept in demo/papers/kept until their commands, programs or inputs change. A run that is interrupted keeps
what is finished and writes the table with what there is.
"""
import os
import pathlib
import subprocess
import sys

import films
import kept
import papers_experiments
import papers_table
from papers_rows import PAPERS

ROOT = pathlib.Path(__file__).resolve().parent.parent
FOLDER = ROOT / "demo" / "papers"


def tell(text, end="\n"):
    print(text, file=sys.stderr, end=end, flush=True)


def benchmarks_folder(program):
    """Where the benchmarks are: beside the program where it was built with them, else built for this."""
    if (program.parent / papers_experiments.BENCHMARKS[0]).exists():
        return program.parent
    tell("building the benchmarks")
    folder = ROOT / "build-bench"
    for command in (["cmake", "-S", ROOT, "-B", folder, "-DCMAKE_BUILD_TYPE=Release", "-DRAYSFM_BUILD_BENCHMARKS=ON"],
                    ["cmake", "--build", folder, "--target", *papers_experiments.BENCHMARKS]):
        done = subprocess.run([str(word) for word in command], capture_output=True, text=True)
        if done.returncode != 0:
            sys.exit(f"scripts/results: {' '.join(map(str, command))} failed: {done.stderr.strip()[-500:]}")
    return folder


def run_one(keeper, experiment, title, prepare):
    if keeper.get(experiment):
        return
    try:
        prepare(experiment, title)
        if keeper.get(experiment):
            return
        if missing := keeper.missing(experiment):
            tell(f"{title}: skipped, {', '.join(missing)} is missing")
            return
        tell(title, end=" ")
        tell(f"{keeper.run(experiment)['seconds']} s")
    except kept.Failed as failed:
        tell(str(failed))


def run_all(keeper, experiments, prepare=lambda experiment, title: None):
    """Runs what is not kept, one after another; returns whether it came to the end. `prepare` makes inputs."""
    try:
        for number, experiment in enumerate(experiments):
            run_one(keeper, experiment, f"[{number + 1}/{len(experiments)}] {experiment.name}", prepare)
    except KeyboardInterrupt:
        tell("\ninterrupted: what is finished is kept")
        return False
    return True


class Session:
    """The experiments of both scales, and what of them is kept."""

    def __init__(self, program, benchmarks, data, folder=FOLDER):
        self.program = program
        self._films = folder / "films"
        self.keeper = kept.Kept(folder / "kept", papers_experiments.paths(program, benchmarks, data, self._films,
                                                                          folder / "kept"))
        self.whole = {e.name: e for e in papers_experiments.experiments(quick=False)}
        self.quick = {e.name: e for e in papers_experiments.experiments(quick=True)}

    def record(self, name):
        """What is kept of an experiment: the whole, else the quick one, else None."""
        return self.keeper.get(self.whole[name]) or self.keeper.get(self.quick[name])

    def records(self):
        """All that is kept, by name, and what follows from it."""
        found = {name: record for name in self.whole if (record := self.record(name))}
        results = {name: record["result"] for name, record in found.items()}
        for name, (result, parts) in papers_experiments.derived(results).items():
            scales = {found[part]["scale"] for part in parts} - {""}
            found[name] = {"result": result, "scale": ", ".join(sorted(scales)), "parts": parts}
        return found

    def run(self, experiments):
        """Runs what is not kept; returns whether it came to the end."""
        return run_all(self.keeper, experiments, self._render_inputs)

    def _render_inputs(self, experiment, title):
        for film in set(experiment.inputs) & set(papers_experiments.RENDERED):
            self._render(film, title)

    def _render(self, film, title):
        recipe, flags = papers_experiments.RENDERED[film]
        path, folder = films.RECIPES / f"{recipe}.yaml", self._films / film
        if films.is_current(folder, path, flags):
            return
        tell(f"{title}: rendering {film}")
        self._films.mkdir(parents=True, exist_ok=True)
        films.render(self.program, folder, path, flags)
        self.keeper.forget(film)


def beyond_limits(records):
    """What the checked rows miss, as texts."""
    missed = []
    for items in PAPERS.values():
        for row in (row for rows in items().values() for row in rows if row.limit is not None):
            record = records.get(row.experiment)
            if record is None:
                continue
            value = papers_table.value_of(row, record)
            if not (isinstance(value, (int, float)) and value < row.limit):
                missed.append(f"{row.item}, {row.what}: {value}, below {row.limit} wanted")
    return missed


def check(program, data):
    """The quick subset against its limits; returns how many are missed. For this the benchmarks need not be there."""
    session = Session(program, program.parent, data)
    session.run([session.whole[name] for name in papers_experiments.CHECKED])
    records = {name: record for name in papers_experiments.CHECKED if (record := session.record(name))}
    missed = beyond_limits(records)
    print(f"papers: {len(records)} of {len(papers_experiments.CHECKED)} experiments, {len(missed)} limits missed")
    for line in missed:
        print(f"  {line}", flush=True)
    return len(missed)


def made_by(program, machine):
    """Version, bytes and machine."""
    version = subprocess.run([str(program), "--version"], capture_output=True, text=True).stdout.split("\n")[0]
    return f"raysfm {version} (sha256 {kept.file_digest(program)[:12]}), {machine}"


def run(program, data, machine, quick=False, only=""):
    """Makes what is missing and writes the table. Returns the exit code: 130 where it was interrupted."""
    session = Session(program, benchmarks_folder(program), data)
    wanted = [e for e in (session.quick if quick else session.whole).values() if only in e.name]
    finished = session.run(wanted)
    os.makedirs(ROOT / "docs" / "images" / "papers", exist_ok=True)
    counts = papers_table.write(ROOT / "docs" / "results" / "papers.md", ROOT / "docs" / "images" / "papers",
                                session.records(), made_by(program, machine), list(session.whole))
    print(f"written: docs/results/papers.md, {counts}")
    return 0 if finished else 130
