"""scripts/check-includes must find what it is there to find."""
import pathlib
import subprocess
import sys
import tempfile
import unittest

SCRIPT = pathlib.Path(__file__).resolve().parent.parent / "scripts" / "check-includes"


def check(files):
    """Exit code and complaints for a tree of the given {path below src/raysfm: text}."""
    with tempfile.TemporaryDirectory() as folder:
        for name, text in files.items():
            path = pathlib.Path(folder, "src", "raysfm", name)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        done = subprocess.run([sys.executable, SCRIPT, folder], capture_output=True, text=True)
        return done.returncode, done.stderr


class CheckIncludes(unittest.TestCase):
    def refused(self, name, text, expected):
        code, complaints = check({name: text})
        self.assertEqual(code, 1)
        self.assertIn(expected, complaints)

    def accepted(self, name, text):
        self.assertEqual(check({name: text}), (0, ""))

    def test_lower_floors_are_allowed(self):
        self.accepted("bundle/a.cpp", '#include "raysfm/scene/b.h"\n#include "raysfm/bundle/c.h"\n')

    def test_same_and_higher_floors_are_not(self):
        self.refused("bundle/a.cpp", '\n#include "raysfm/robust/b.h"\n', "a.cpp:2: bundle (floor 5) includes robust")
        self.refused("core/a.h", '#include "raysfm/geometry/b.h"\n', "core (floor 0) includes geometry (floor 1)")

    def test_tests_may_use_other_folders(self):
        self.accepted("bundle/a_test.cpp", '#include "raysfm/robust/b.h"\n#include <opencv2/core.hpp>\n')

    def test_unknown_folders(self):
        self.refused("stuff/a.h", "", "has no floor")
        self.refused("core/a.h", '#include "raysfm/stuff/b.h"\n', "has no floor")

    def test_opencv_and_ffmpeg_stay_where_they_are_needed(self):
        self.accepted("frames/a.cpp", "#include <opencv2/core.hpp>\n#include <libavcodec/avcodec.h>\n")
        self.accepted("plots/a.cpp", "#include <opencv2/core.hpp>\n")
        self.refused("features/a.cpp", "#include <opencv2/core.hpp>\n", "only frames/, matching/, plots/ may include it")
        self.refused("plots/a.cpp", "#include <libswscale/swscale.h>\n", "only frames/ may include it")

    def test_crowded_folders(self):
        files = {f"core/a{i}.h": "" for i in range(40)}
        self.assertEqual(check(files), (0, ""))
        code, complaints = check(files | {"core/b.h": ""})
        self.assertEqual(code, 1)
        self.assertIn("core: 41 files, at most 40 are allowed", complaints)

    def test_the_library_does_not_print_or_exit(self):
        for line in ("std::cout << 1;", 'printf("x");', 'std::printf("x");', 'fmt::print("x");', "std::exit(1);",
                     "exit(1);", "fprintf(stderr, message);"):
            self.refused("core/a.cpp", f"void f() {{\n{line}\n}}\n", "a.cpp:2: ")

    def test_words_that_only_look_like_it(self):
        self.accepted("core/a.cpp", '// std::cout\nauto s = "printf(1)"; snprintf(b, 1, f); on_exit(1); x.exit(2);\n')

    def test_relative_includes(self):
        self.refused("core/a.cpp", '#include "../core/b.h"\n', "paths begin with raysfm/")

    def test_nothing_to_check_is_an_error(self):
        self.assertEqual(check({})[0], 1)


if __name__ == "__main__":
    unittest.main()
