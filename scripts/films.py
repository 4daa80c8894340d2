"""Sequences that are rendered from the recipes of scripts/recipes, and rendered anew when the recipe or what renders it
changed. For scripts/results."""
import hashlib
import os
import pathlib
import re
import shutil
import subprocess

import kept

ROOT = pathlib.Path(__file__).resolve().parent.parent
RECIPES = ROOT / "scripts" / "recipes"
# Where the pictures come from. The rest of the program may change without a picture changing.
SOURCES = [ROOT / "src" / "raysfm" / room for room in ("synth", "worlds", "models")]


def camera_of(recipe):
    found = re.search(r"^camera: (\S+)", recipe.read_text(), re.MULTILINE)
    return RECIPES / found.group(1) if found else recipe


def made_of(recipe, flags):
    parts = [recipe, camera_of(recipe), *(source for source in SOURCES if source.exists())]
    return hashlib.sha256("".join([*map(kept.file_digest, parts), *map(str, flags)]).encode()).hexdigest()


def is_current(folder, recipe, flags):
    stamp = folder / "made_of"
    return stamp.exists() and stamp.read_text() == made_of(recipe, flags)


def render(program, folder, recipe, flags):
    """Renders into `folder` unless it holds just that. Errors: kept.Failed."""
    if is_current(folder, recipe, flags):
        return
    fresh = folder.with_name(f"{folder.name}.{os.getpid()}")
    command = [program, "synth", "--config", recipe, "--out", fresh, "--quiet", *flags]
    try:
        done = subprocess.run([str(word) for word in command], capture_output=True, text=True)
        if done.returncode != 0:
            raise kept.Failed(f"{recipe.name}: synth ended with {done.returncode}: {done.stderr.strip()}")
        (fresh / "made_of").write_text(made_of(recipe, flags))
        shutil.rmtree(folder, ignore_errors=True)
        os.replace(fresh, folder)
    finally:
        shutil.rmtree(fresh, ignore_errors=True)
