"""Experiments that are kept until what they were made of changes. For scripts/results.

An experiment is a list of commands and a function that takes numbers from what they leave. Its result is a file of the
folder of a `Kept`, with a digest of the commands, of the programs they run, of their inputs and of that function. It
holds as long as the digest is the same.
"""
import dataclasses
import datetime
import hashlib
import inspect
import json
import os
import pathlib
import shutil
import subprocess
import tempfile
import time
import typing

HERE = pathlib.Path(__file__).resolve().parent


@dataclasses.dataclass
class Experiment:
    """`commands` are lists of words, run in a folder of their own: {NAME} stands for the path of a program or of an
    input, {out} for the folder. `measure(folder, outputs)` gives a dictionary that JSON can hold; `outputs` has what each
    command printed, with its `seconds` and `error`. An experiment whose `inputs` are missing is not run."""
    name: str
    commands: list
    measure: typing.Callable
    programs: list = dataclasses.field(default_factory=list)
    inputs: list = dataclasses.field(default_factory=list)
    scale: str = ""  # what was left out, where it is not the whole
    leaves: dict = dataclasses.field(default_factory=dict)  # files for other experiments: {NAME: path below {out}}
    may_fail: bool = False  # a command that ends with an error is a result: `measure` sees what there is


class Printed(str):
    """What a command printed, its errors and the last line of them, its exit code, how long it took, and
    how long of the processor."""
    error = errors = ""
    code = 0
    seconds = processor_seconds = 0.0


class Failed(Exception):
    """A command that ended with an error, as one line."""


def file_digest(path):
    """Of a file, or of all files of a folder with their names."""
    total = hashlib.sha256()
    paths = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    for each in paths:
        total.update(str(each.relative_to(path)).encode() if path.is_dir() else b"")
        with open(each, "rb") as file:
            while block := file.read(1 << 20):
                total.update(block)
    return total.hexdigest()


class Digests:
    """Digests of paths, each worked out once in a run."""

    def __init__(self):
        self._known = {}

    def of(self, path):
        if path not in self._known:
            self._known[path] = file_digest(path)
        return self._known[path]

    def forget(self, path):
        self._known.pop(path, None)


def processor_seconds():
    """Of all programs run so far."""
    times = os.times()
    return times.children_user + times.children_system


def names_in(code):
    """Of a function's code and of the code within it."""
    inner = [name for constant in code.co_consts if inspect.iscode(constant) for name in names_in(constant)]
    return [*code.co_names, *inner]


def is_ours(path):
    return path is not None and pathlib.Path(path).resolve().parent == HERE


def source_of(function, seen=None):
    """Text of a function, of the functions of these scripts that it calls, and of the modules of these scripts it uses."""
    seen = {} if seen is None else seen
    seen[function] = inspect.getsource(function)
    for name in names_in(function.__code__):
        used = function.__globals__.get(name)
        if inspect.isfunction(used) and used not in seen and is_ours(used.__code__.co_filename):
            source_of(used, seen)
        if inspect.ismodule(used) and is_ours(getattr(used, "__file__", None)):
            seen[used] = inspect.getsource(used)
    return "".join(sorted(seen.values()))


def program_files(path):
    """A program and the modules beside it that it loads."""
    return [path, *sorted(path.parent.glob(path.name + "-*.so"))]


class Kept:
    def __init__(self, folder, paths):
        """`paths` gives the path of each {NAME}."""
        self.folder = folder
        self._paths = paths
        self._digests = Digests()

    def digest(self, experiment):
        made_of = [experiment.commands, source_of(experiment.measure)]
        for name in experiment.programs:
            made_of.append([self._digests.of(p) for p in program_files(self._paths[name])])
        made_of += [self._digests.of(self._paths[name]) for name in experiment.inputs]
        return hashlib.sha256(json.dumps(made_of).encode()).hexdigest()

    def forget(self, name):
        """What is at a path has changed."""
        self._digests.forget(self._paths[name])

    def missing(self, experiment):
        """Names of what is not there."""
        return [name for name in experiment.programs + experiment.inputs if not self._paths[name].exists()]

    def get(self, experiment):
        """The record of a finished experiment that still holds, or None."""
        path = self._file(experiment)
        if not path.exists() or self.missing(experiment):
            return None
        record = json.loads(path.read_text())
        return record if record["digest"] == self.digest(experiment) else None

    def run(self, experiment):
        """Runs it and keeps its record. Errors: Failed."""
        digest, begin, used = self.digest(experiment), time.monotonic(), processor_seconds()
        with tempfile.TemporaryDirectory() as folder:
            outputs = [self._execute(command, experiment, folder) for command in experiment.commands]
            try:
                result = experiment.measure(pathlib.Path(folder), outputs)
            except Exception as what:  # nothing that one experiment leaves out stops the others
                raise Failed(f"{experiment.name}: {type(what).__name__}: {what}") from what
            self._take(experiment, pathlib.Path(folder))
        record = {"digest": digest, "load": round(os.getloadavg()[0], 1), "result": result, "scale": experiment.scale,
                  "seconds": round(time.monotonic() - begin, 1),
                  "processor_seconds": round(processor_seconds() - used, 1), "commands": self.shown(experiment),
                  "made": datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%d %H:%M UTC")}
        self.folder.mkdir(parents=True, exist_ok=True)
        fresh = self._file(experiment).with_suffix(".new")
        fresh.write_text(json.dumps(record))
        os.replace(fresh, self._file(experiment))
        return record

    def _take(self, experiment, folder):
        for name, file in experiment.leaves.items():
            if (folder / file).exists():
                self.folder.mkdir(parents=True, exist_ok=True)
                shutil.copy(folder / file, self._paths[name])
                self._digests.forget(self._paths[name])

    @staticmethod
    def shown(experiment):
        """Its commands as one types them: names in place of paths."""
        return [" ".join(word.replace("{", "").replace("}", "") for word in command) for command in experiment.commands]

    def _file(self, experiment):
        part = ", part" if experiment.scale else ""  # a part never takes the place of the whole
        return self.folder / (f"{experiment.name}{part}.json".replace(" ", "_"))

    def _execute(self, command, experiment, folder):
        known = {name: str(path) for name, path in self._paths.items()} | {"out": folder}
        words = [word.format_map(known) for word in command]
        begin, used = time.monotonic(), processor_seconds()
        done = subprocess.run(words, capture_output=True, text=True, cwd=folder)
        if done.returncode != 0 and not experiment.may_fail:
            raise Failed(f"{experiment.name}: {command[0]} ended with {done.returncode}: {done.stderr.strip()[-300:]}")
        printed = Printed(done.stdout)
        printed.errors, printed.code = done.stderr, done.returncode
        printed.error = (done.stderr.strip().splitlines() or [""])[-1]
        printed.seconds, printed.processor_seconds = time.monotonic() - begin, processor_seconds() - used
        return printed
