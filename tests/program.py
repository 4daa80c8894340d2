"""What the tests of the program share: running it, and files made on the fly."""
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

PROGRAM = ""


def main():
    """Runs the tests of the calling script: SCRIPT PROGRAM [unittest arguments]."""
    global PROGRAM
    PROGRAM = os.path.abspath(sys.argv.pop(1))  # tests run it in other folders
    unittest.main()


def run(*arguments, stdout=subprocess.PIPE, **options):
    command = [PROGRAM, *map(str, arguments)]
    return subprocess.run(command, stdout=stdout, stderr=subprocess.PIPE, text=True, timeout=300, check=False, **options)


class ProgramTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def file(self, name, content):
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    def refused(self, *arguments, says, **options):
        """The command fails with exit code 2 and one line that holds every text of `says`."""
        done = run(*arguments, **options)
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertEqual(done.stdout, "")
        self.assertEqual(done.stderr.count("\n"), 1, done.stderr)
        for text in says:
            self.assertIn(str(text), done.stderr)
