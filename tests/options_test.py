"""Manual page and completions are made from the options: options_test.py PROGRAM [unittest arguments]."""
import re
import shutil
import subprocess
import unittest

import program
from program import ProgramTest, run

COMMANDS = ["track", "solve", "adjust", "synth", "eval", "camera show", "camera convert", "camera check", "export", "view", "map show",
            "map check", "batch"]


def flags_of(command):
    """As --help tells them."""
    return set(re.findall(r"^  (?:-\w,)?(--[\w-]+)", run(*command.split(), "--help").stdout, re.MULTILINE)) - {"--help"}


class Options(ProgramTest):
    def text(self, kind):
        done = run("options", kind)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        return done.stdout

    def test_only_known_formats(self):
        self.refused("options", "fish", says=["fish"])
        self.assertNotIn("options", re.findall(r"^  (\w+) ", run("--help").stdout, re.MULTILINE))

    def test_the_manual_has_every_command_and_flag(self):
        page = self.text("man")
        self.assertGreater(sum(len(flags_of(command)) for command in COMMANDS), 60)
        for command in COMMANDS:
            begin = page.index(f".SS raysfm {command} ")
            end = page.find(".SS", begin + 4)
            here = page[begin:end].replace("\\-", "-")
            flags = flags_of(command)
            for flag in flags:
                self.assertIn(f"\\fB{flag}\\fR", here, command)
        if shutil.which("man"):
            path = self.file("raysfm.1", page)
            done = subprocess.run(["man", "--warnings", "--encoding", "UTF-8", "--local-file", path], text=True, capture_output=True,
                                  env={"PATH": "/usr/bin:/bin", "MANWIDTH": "100", "LC_ALL": "C.UTF-8"})
            self.assertEqual((done.returncode, done.stderr), (0, ""))
            for shown in ("--refine-lens auto|on|off", "--view [[ADDRESS:]PORT]", "--port [ADDRESS:]PORT", "--jobs INT\n"):
                self.assertIn(shown, done.stdout)

    def completed(self, *words):
        """What bash offers for the last of the words."""
        script = self.file("completion", self.text("bash"))
        code = 'source "$1"; shift; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _raysfm; printf "%s\\n" "${COMPREPLY[@]}"'
        done = subprocess.run(["bash", "-euo", "pipefail", "-c", code, "bash", script, "raysfm", *words], text=True, capture_output=True)
        self.assertEqual(done.stderr, "")
        return set(done.stdout.split())

    def test_bash_completes(self):
        self.assertEqual(self.completed("tr"), {"track"})
        self.assertEqual(self.completed("camera", ""), {"show", "convert", "check", "calibrate"} | {w for w in self.completed("camera", "-")})
        self.assertEqual(self.completed("track", "video.mp4", "--refine-lens", ""), {"auto", "on", "off"})
        self.assertEqual(self.completed("track", "video.mp4", "--refine-lens", "o"), {"on", "off"})
        self.assertEqual(self.completed("track", ""), set())  # files, which bash itself knows
        self.assertEqual(self.completed("track", "--refine-lens", "on", "vid"), set())
        for command in COMMANDS:
            offered = self.completed(*command.split(), "--")
            self.assertLessEqual(flags_of(command), offered, command)
            self.assertLessEqual({"--quiet", "--threads"}, offered)

    @unittest.skipUnless(shutil.which("zsh"), "no zsh")
    def test_zsh_completes(self):
        script = self.file("_raysfm", self.text("zsh"))
        code = ('compadd() { print -l -- "${@[2,-1]}" }; _files() { print FILES }; complete_() { local PREFIX=${words[CURRENT]}; '
                'source $script }; script=$1; shift; words=("$@"); CURRENT=$#; complete_')
        for words, expected in ((["track", "v.mp4", "--loops", ""], {"on", "off"}), (["track", ""], {"FILES"})):
            done = subprocess.run(["zsh", "-f", "-c", code, "zsh", script, "raysfm", *words], text=True, capture_output=True)
            self.assertEqual((set(done.stdout.split()), done.stderr), (expected, ""))
        for command in COMMANDS:
            done = subprocess.run(["zsh", "-f", "-c", code, "zsh", script, "raysfm", *command.split(), "--"], text=True, capture_output=True)
            self.assertLessEqual(flags_of(command), set(done.stdout.split()), done.stderr)


if __name__ == "__main__":
    program.main()
