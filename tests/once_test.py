"""scripts/once: what passed is not run again until something differs that its check depends on."""
import json
import os
import pathlib
import shutil
import subprocess
import tempfile
import unittest

SCRIPTS = pathlib.Path(__file__).resolve().parent.parent / "scripts"


class OnceTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.marks = pathlib.Path(folder.name) / "marks"
        self.root = pathlib.Path(folder.name) / "project"
        for script in ("once", "changed"):
            self.write(f"scripts/{script}", (SCRIPTS / script).read_text()).chmod(0o755)
        self.write("src/deep.h", "// deep\n")
        self.write("src/near.h", '#include "deep.h"\n')
        self.write("src/a.cpp", '#include "near.h"\n#include <vector>\n')
        self.write("src/b.cpp", "int b;\n")
        self.git("init", "--quiet")
        self.commit("2020-01-01")

    def write(self, name, text):
        path = self.root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        return path

    def git(self, *arguments, **environment):
        subprocess.run(["git", "-c", "user.name=a", "-c", "user.email=a@b", *arguments], cwd=self.root, check=True,
                       capture_output=True, env={**os.environ, **environment})

    def commit(self, day):
        self.git("add", "--all")
        self.git("commit", "--quiet", "--allow-empty", "--message", day, GIT_AUTHOR_DATE=f"{day}T12:00:00",
                 GIT_COMMITTER_DATE=f"{day}T12:00:00")

    def once(self, *options, command=("cat",), flags="-O2", root=None):
        """Exit code, all but the last line that was printed, and the numbers of that."""
        root = root or self.root
        entries = [{"directory": str(root), "file": str(root / f"src/{name}.cpp"),
                    "command": f"/usr/bin/ccache c++ -I{root}/src {flags} -o {name}.o -c {root}/src/{name}.cpp"} for name in "ab"]
        build = root / "build"
        build.mkdir(exist_ok=True)
        (build / "compile_commands.json").write_text(json.dumps(entries))
        (root / ".gitignore").write_text("/build/\n.gitignore\n")
        done = subprocess.run([root / "scripts/once", build, *options, "--", *command], capture_output=True, text=True,
                              check=False, env={**os.environ, "RAYSFM_ONCE": str(self.marks)})
        self.assertEqual(done.stderr, "")
        *lines, last = done.stdout.splitlines()
        words = last.replace(",", "").split()
        counts = {"before": int(words[0]), "passed": int(words[3]), "failed": int(words[5]), "left": int(words[-1])}
        return done.returncode, lines, counts

    def counts(self, *options, **arguments):
        code, _, counts = self.once(*options, **arguments)
        self.assertEqual(code, 1 if counts["failed"] else 0)
        return tuple(counts.values())

    def test_what_passed_is_not_run_again(self):
        self.assertEqual(self.counts(), (0, 2, 0, 0))
        self.assertEqual(self.counts(), (2, 0, 0, 0))
        self.assertEqual(self.counts("--afresh"), (0, 2, 0, 0))

    def test_what_is_included_counts(self):
        self.counts()
        self.write("src/deep.h", "// deeper\n")
        self.assertEqual(self.counts(), (1, 1, 0, 0))
        self.write("src/deep.h", "// deep\n")
        self.assertEqual(self.counts(), (2, 0, 0, 0))

    def test_flags_command_and_rules_count(self):
        self.counts()
        self.assertEqual(self.counts(flags="-O3"), (0, 2, 0, 0))
        self.assertEqual(self.counts(command=("head",)), (0, 2, 0, 0))
        self.write(".clang-tidy", "Checks: all\n")
        self.assertEqual(self.counts(), (0, 2, 0, 0))

    def test_what_fails_is_shown_and_run_again(self):
        self.write("src/b.cpp", "WRONG\n")
        command = ("sh", "-c", 'cat "$0"; ! grep -q WRONG "$0"')
        for before, passed in ((0, 1), (1, 0)):
            code, lines, counts = self.once(command=command)
            self.assertEqual((code, lines), (1, ["WRONG", ""]))
            self.assertEqual(tuple(counts.values()), (before, passed, 1, 0))
        self.write("src/b.cpp", "right\n")
        self.assertEqual(self.counts(command=command), (1, 1, 0, 0))

    def test_a_clone_elsewhere_is_served(self):
        self.write("src/b.cpp", f'#include "{self.root}/src/deep.h"\n')  # as sources are joined
        self.counts()
        clone = self.root.parent / "clone"
        shutil.copytree(self.root, clone)
        (clone / "src/b.cpp").write_text(f'#include "{clone}/src/deep.h"\n')
        self.assertEqual(self.counts(root=clone), (2, 0, 0, 0))

    def test_it_ends_when_its_time_is_over(self):
        self.assertEqual(self.counts("--minutes", "0"), (0, 0, 0, 2))
        self.assertEqual(self.counts(), (0, 2, 0, 0))

    def test_the_command_gets_how_a_unit_is_compiled(self):
        compiled = f"c++ -I{self.root}/src -O2 -fsyntax-only"
        command = ("sh", "-c", f'test "$1 $2 $3 $4" = "{compiled}" && test -f "$5" && test $# = 5', "sh", "{compile}", "-fsyntax-only")
        self.assertEqual(self.counts(command=command), (0, 2, 0, 0))

    def test_what_changed_of_late_is_first(self):
        self.addCleanup(os.sched_setaffinity, 0, os.sched_getaffinity(0))
        os.sched_setaffinity(0, {0})  # one at a time
        order = self.root.parent / "order"
        for month, name in enumerate("aabb", 2):  # each twice, whatever the turn
            self.write(f"src/{name}.cpp", f"// {month}\n")
            self.commit(f"2020-0{month}-01")
            order.write_text("")
            self.counts("--afresh", command=("sh", "-c", f'echo "$0" >>{order}'))
            self.assertEqual(pathlib.Path(order.read_text().split()[0]).stem, name)


if __name__ == "__main__":
    unittest.main()
