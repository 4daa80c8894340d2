"""The subcommand `export`: export_test.py PROGRAM [unittest arguments]. What is written is read by COLMAP and Blender,
which tell what they see, and compared with the map's own pixels in sparse/."""
import json
import pathlib
import re
import shutil
import struct
import subprocess
import tempfile
import unittest

import adjust_test
import program
from program import ProgramTest, run

STREET = OUT = None  # a sequence of 40 frames, 512 x 384 pixels, and what `track` makes of it
# Nothing is in the middle and no pixel is square: what is swapped or left out shows.
CAMERA = """raysfm_camera: 1
cameras:
  - {name: cam, model: pinhole, resolution: [512, 384], intrinsics: {fx: 400, fy: 420, cx: 235, cy: 204}}
"""


def setUpModule():
    global STREET, OUT
    folder = tempfile.TemporaryDirectory()
    unittest.addModuleCleanup(folder.cleanup)
    STREET, OUT = pathlib.Path(folder.name) / "street", pathlib.Path(folder.name) / "out"
    camera = pathlib.Path(folder.name) / "camera.yaml"
    camera.write_text(CAMERA)
    for command in (["synth", "street", "--camera", camera, "--frames", 40, "--fps", 7.5, "--length", 6, "--samples", 1, "--out", STREET],
                    ["track", STREET, "--out", OUT]):
        done = run(*command, "--quiet")
        assert (done.returncode, done.stderr) == (0, ""), done.stderr


def contents(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def read_images_bin(path):
    """{name: [(x, y, point), ...]} by the definition of COLMAP's binary files."""
    bytes_, at, images = path.read_bytes(), 8, {}
    for _ in range(struct.unpack_from("<Q", bytes_)[0]):
        at += struct.calcsize("<I7dI")
        end = bytes_.index(b"\0", at)
        name = bytes_[at:end].decode()
        count = struct.unpack_from("<Q", bytes_, end + 1)[0]
        images[name] = [struct.unpack_from("<ddQ", bytes_, end + 9 + 24 * k) for k in range(count)]
        at = end + 9 + 24 * count
    return images


def size_of_png(path):
    return struct.unpack_from(">II", path.read_bytes(), 16)


class ExportTest(ProgramTest):
    def export(self, *arguments, source=None, says=()):
        out = self.folder / "exported"
        done = run("export", source or OUT, "--out", out, *arguments)
        self.assertEqual(done.returncode, 0, done.stderr)
        for text in says:
            self.assertIn(text, done.stdout + done.stderr)
        self.assertEqual(set(json.loads((out / "export.json").read_text())["files"]), set(contents(out)))
        return out


@unittest.skipUnless(shutil.which("colmap"), "colmap is not installed")
class ReadByColmap(ExportTest):
    def analyzed(self, model):
        done = subprocess.run(["colmap", "model_analyzer", "--path", model], capture_output=True, text=True, timeout=60,
                              check=True)
        fields = {}
        for line in (done.stdout + done.stderr).splitlines():
            name, _, value = line.partition(": ")
            fields[name.split("] ")[-1]] = value
        return fields

    def test_binary_text_and_undistorted(self):
        report = json.loads((OUT / "report.json").read_text())
        keyframes = len(read_images_bin(OUT / "sparse/images.bin"))
        for arguments in ([], ["--text"], ["--undistort"]):
            model = self.export("--format", "colmap", *arguments) / "sparse/0"
            self.assertEqual(len(list(model.iterdir())), 3)
            found = self.analyzed(model)
            self.assertEqual((int(found["Cameras"]), int(found["Registered images"])), (1, keyframes))
            points = report["worlds"][0]["points"]
            if "--undistort" in arguments:
                self.assertIn(int(found["Points"]), range(points * 8 // 10, points + 1))
            else:
                self.assertEqual(int(found["Points"]), points)
            self.assertLess(float(found["Mean reprojection error"][:-2]), 1)

    def test_colmap_sees_the_points_where_they_were(self):
        """By its own projection: the cost with which its adjustment begins, half the root of the mean square."""
        report = json.loads((OUT / "report.json").read_text())
        for arguments in ([], ["--text"], ["--undistort"]):
            model = self.export("--format", "colmap", *arguments) / "sparse/0"
            (self.folder / "adjusted").mkdir(exist_ok=True)
            done = subprocess.run(["colmap", "bundle_adjuster", "--input_path", model, "--output_path", self.folder / "adjusted",
                                   "--BundleAdjustment.max_num_iterations", "0"], capture_output=True, text=True, timeout=60, check=True)
            cost = re.search(r"Initial cost : ([\d.]+) \[px\]", done.stdout + done.stderr)
            self.assertTrue(cost, done.stdout + done.stderr)
            # Undistorted, pixels are of another size.
            delta = 0.05 * report["rms_reprojection_px"] if "--undistort" in arguments else 1e-4
            self.assertAlmostEqual(2 * float(cost.group(1)), report["rms_reprojection_px"], delta=delta)

    def test_colmap_writes_the_same_model(self):
        model = self.export("--format", "colmap") / "sparse/0"
        again = self.folder / "again"
        again.mkdir()
        subprocess.run(["colmap", "model_converter", "--input_path", model, "--output_path", again, "--output_type", "BIN"],
                       capture_output=True, timeout=60, check=True)
        self.assertEqual(read_images_bin(again / "images.bin"), read_images_bin(model / "images.bin"))
        self.assertEqual(sorted(read_images_bin(model / "images.bin").values()),
                         sorted(read_images_bin(OUT / "sparse/images.bin").values()))


BLENDER = """
import bpy, json, sys
from bpy_extras.object_utils import world_to_camera_view
scene = bpy.context.scene
points = bpy.data.objects["raysfm points"]
seen = []
for frame in json.loads(sys.argv[-1]):
    scene.frame_set(frame)
    bpy.context.view_layer.update()
    w, h = scene.render.resolution_x, scene.render.resolution_y
    views = [world_to_camera_view(scene, scene.camera, points.matrix_world @ v.co) for v in points.data.vertices]
    seen.append([(v.x * w, (1 - v.y) * h, v.z) for v in views])
up = scene.camera.matrix_world.to_quaternion() @ __import__("mathutils").Vector((0, 1, 0))
print("SEEN " + json.dumps([seen, list(up), [scene.frame_start, scene.frame_end, scene.render.fps / scene.render.fps_base]]))
"""


@unittest.skipUnless(shutil.which("blender"), "blender is not installed")
class RunInBlender(ExportTest):
    def test_cameras_see_the_points_where_they_were(self):
        out = self.export("--format", "blender")
        script = self.file("look.py", BLENDER)
        timestamps = [float(line) for line in (STREET / "times.txt").read_text().split()]
        keyframes = [float(line.split()[0]) for line in (OUT / "keyframes.txt").read_text().splitlines() if line[0] != "#"]
        frames = [1 + min(range(len(timestamps)), key=lambda i: abs(timestamps[i] - t)) for t in keyframes]
        done = subprocess.run(["blender", "--background", "--factory-startup", "--python", out / "scene.py", "--python", script,
                               "--", json.dumps(frames)], capture_output=True, text=True, timeout=280, check=False)
        line = [line for line in done.stdout.splitlines() if line.startswith("SEEN ")]
        self.assertTrue(line, done.stdout + done.stderr)
        seen, up, (first, last, fps) = json.loads(line[0][5:])
        self.assertEqual((first, last), (1, 40))
        self.assertAlmostEqual(fps, 7.5, places=3)
        self.assertGreater(up[2], 0.9)  # the drive is level: z is up
        observed = sorted(read_images_bin(OUT / "sparse/images.bin").items())
        errors = []
        self.assertEqual(len(observed), len(seen))
        for (_, keypoints), pixels in zip(observed, seen):
            for x, y, point in keypoints:
                u, v, depth = pixels[point - 1]
                self.assertGreater(depth, 0)
                errors.append(((u - x) ** 2 + (v - y) ** 2) ** 0.5)
        self.assertGreater(len(errors), 500)
        # The map's own error: what sparse/ says of its points, by another way.
        report = json.loads((OUT / "report.json").read_text())
        rms = (sum(e * e for e in errors) / len(errors)) ** 0.5
        self.assertAlmostEqual(rms, report["rms_reprojection_px"], delta=0.01)


class Images(ExportTest):
    def test_undistorted_images_have_the_size_of_their_camera(self):
        out = self.export("--format", "nerfstudio", "--undistort", "--images", STREET)
        scene = json.loads((out / "transforms.json").read_text())
        self.assertEqual((scene["cx"], scene["cy"]), (scene["w"] / 2, scene["h"] / 2))
        self.assertEqual(scene["fl_x"], scene["fl_y"])
        for frame in scene["frames"]:
            self.assertEqual(size_of_png(out / frame["file_path"]), (scene["w"], scene["h"]))
        self.assertEqual(len(list((out / "images").iterdir())), len(scene["frames"]))

    def test_every_frame_with_a_pose(self):
        out = self.export("--format", "colmap", "--all-frames", "--images", STREET)
        images = read_images_bin(out / "sparse/0/images.bin")
        self.assertEqual(len(images), 40)
        self.assertEqual({path.name for path in (out / "images").iterdir()}, set(images))
        self.assertEqual(sum(not keypoints for keypoints in images.values()),
                         40 - len(read_images_bin(OUT / "sparse/images.bin")))

    def test_a_panorama_becomes_a_cube(self):
        source, out = self.folder / "panorama", self.folder / "out"
        camera = self.file("camera.yaml", "raysfm_camera: 1\ncameras:\n  - name: ring\n    model: equirectangular\n"
                                          "    resolution: [640, 320]\n")
        done = run("synth", "street", "--camera", camera, "--frames", 20, "--fps", 7.5, "--length", 3, "--samples", 1, "--out",
                   source, "--quiet")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(run("track", source, "--out", out, "--quiet").returncode, 0)
        # sparse/ cannot hold it: camera.yaml tells the camera, or, of older results, --camera.
        told = out / "camera.yaml"
        self.assertIn("camera.yaml", json.loads((out / "report.json").read_text())["files"])
        self.refused("export", out, "--format", "colmap", "--out", self.folder / "no", says=["equirectangular", "--undistort"])
        told.rename(self.folder / "told.yaml")
        self.refused("export", out, "--format", "colmap", "--out", self.folder / "no", says=["--camera"])
        self.assertFalse((self.folder / "no").exists())
        arguments = ["--camera", source / "camera.yaml"]
        given = contents(self.export("--format", "colmap", "--undistort", "--images", source, *arguments, source=out))
        (self.folder / "told.yaml").rename(told)
        cube = self.export("--format", "colmap", "--undistort", "--images", source, source=out)
        self.assertEqual([name for name, content in contents(cube).items() if given.get(name) != content], [])
        page = self.folder / "page.html"
        self.assertEqual(run("view", out, "--html", page).returncode, 0)
        camera = json.loads(re.search(r'id="data">(.*?)</script>', page.read_text()).group(1))["cameras"][0]
        self.assertEqual((camera["size"], len(camera["directions"])), ([640, 320], 24))
        names = set(read_images_bin(cube / "sparse/0/images.bin"))
        self.assertEqual({name.split("/")[0] for name in names}, {"front", "right", "back", "left", "down", "up"})
        self.assertEqual(names, {str(p.relative_to(cube / "images")) for p in (cube / "images").rglob("*.png")})
        rig = json.loads((cube / "rig_config.json").read_text())
        self.assertEqual(len(rig[0]["cameras"]), 6)
        # Who sees what is in the result all the same: the cube's images have keypoints, and there is a surface.
        report = json.loads((out / "report.json").read_text())
        seen = sum(map(len, read_images_bin(cube / "sparse/0/images.bin").values()))
        self.assertGreater(seen, 0.9 * report["observations"])
        self.assertIn("mesh.jpg", contents(self.export("--format", "mesh", "--world", 0, source=out)))


class Folders(ExportTest):
    def test_replaced_as_a_whole(self):
        out = self.export("--format", "nerfstudio", "--images", STREET)
        self.file("exported/mine.txt", "mine")
        again = run("export", OUT, "--out", out, "--format", "tum")
        self.assertEqual(again.returncode, 0, again.stderr)
        self.assertEqual(set(contents(out)), {"trajectory.txt", "export.json", "mine.txt"})
        before = contents(out)
        self.refused("export", OUT, "--out", out, "--format", "colmap", "--images", self.folder / "nothing", says=["nothing"])
        self.assertEqual(contents(out), before)
        self.assertEqual([p for p in self.folder.iterdir() if p.name.startswith(".")], [])

    def test_beside_the_result_where_nothing_is_said(self):
        result = self.folder / "a 'result' \u00e4"
        shutil.copytree(OUT, result)
        done = run("export", result, "--format", "euroc")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertTrue((self.folder / "a 'result' \u00e4-euroc/data.csv").exists())
        self.assertEqual(contents(result), contents(OUT))

    def read_ply(self, path):
        """Positions, colours and faces, by the definition of PLY and the header's own list."""
        bytes_ = path.read_bytes()
        header, _, body = bytes_.partition(b"end_header\n")
        counts = {words[1]: int(words[2]) for words in (line.split() for line in header.decode().splitlines()) if words[0] == "element"}
        self.assertIn(b"format binary_little_endian 1.0", header)
        vertices = [struct.unpack_from("<3f3B", body, 15 * v) for v in range(counts["vertex"])]
        faces = [struct.unpack_from("<B3i", body, 15 * len(vertices) + 13 * f) for f in range(counts["face"])]
        self.assertEqual(len(body), 15 * len(vertices) + 13 * len(faces))
        self.assertEqual({face[0] for face in faces}, {3})
        return vertices, [face[1:] for face in faces]

    def read_obj(self, path):
        positions, places, faces = [], [], []
        for words in (line.split() for line in path.read_text().splitlines()):
            if words[0] == "v":
                positions.append(tuple(map(float, words[1:])))
            elif words[0] == "vt":
                places.append(tuple(map(float, words[1:])))
            elif words[0] == "f":
                faces.append([tuple(int(n) - 1 for n in corner.split("/")) for corner in words[1:]])
        return positions, places, faces

    def test_a_surface(self):
        out = self.export("--format", "mesh", says=["faces"])
        self.assertEqual(set(contents(out)), {"mesh.ply", "mesh.obj", "mesh.mtl", "mesh.jpg", "export.json"})
        vertices, faces = self.read_ply(out / "mesh.ply")
        positions, places, textured = self.read_obj(out / "mesh.obj")
        self.assertGreater(len(faces), 300)
        self.assertEqual([tuple(v for v, _ in face) for face in textured], faces)
        for position, vertex in zip(positions, vertices, strict=True):
            for a, b in zip(position, vertex):
                self.assertAlmostEqual(a, b, delta=1e-5 * max(1, abs(b)))
        self.assertTrue(all(0 <= x <= 1 for place in places for x in place))
        edges = [edge for face in faces for edge in zip(face, face[1:] + face[:1])]
        self.assertEqual(len(edges), len(set(edges)), "an edge has two faces that go round the same way")
        self.assertEqual(sorted({v for face in faces for v in face}), list(range(len(vertices))))
        again = self.folder / "again"
        self.assertEqual(run("--threads", 1, "export", OUT, "--format", "mesh", "--out", again, "--images", STREET).returncode, 0)
        self.assertEqual(contents(again), contents(out))

    def test_a_surface_without_images(self):
        source = self.folder / "moved"
        shutil.copytree(OUT, source)
        report = json.loads((source / "report.json").read_text())
        report["input"] = [str(self.folder / "gone")]
        (source / "report.json").write_text(json.dumps(report))
        out = self.export("--format", "mesh", source=source, says=["no texture", "gone"])
        self.assertEqual(set(contents(out)), {"mesh.ply", "export.json"})
        self.refused("export", source, "--format", "mesh", "--out", self.folder / "no", "--images", self.folder / "gone", says=["gone"])
        self.refused("export", OUT, "--format", "mesh", "--texture-side", 10, says=["--texture-side", "10", "64"])
        self.refused("export", OUT, "--format", "mesh", "--undistort", says=["--undistort"])

    @unittest.skipUnless(shutil.which("blender"), "blender is not installed")
    def test_blender_reads_the_surface(self):
        out = self.export("--format", "mesh")
        script = self.folder / "read.py"
        script.write_text(f"""import bpy
bpy.ops.wm.obj_import(filepath={str(out / "mesh.obj")!r})
mesh = bpy.context.selected_objects[0].data
image = [node.image for node in mesh.materials[0].node_tree.nodes if node.type == "TEX_IMAGE"][0]
print("READ", len(mesh.vertices), len(mesh.polygons), len(mesh.uv_layers), *image.size)
""")
        done = subprocess.run(["blender", "--background", "--factory-startup", "--python", script], capture_output=True, text=True, timeout=120)
        line = next((line for line in done.stdout.splitlines() if line.startswith("READ")), done.stdout + done.stderr)
        vertices, faces = self.read_ply(out / "mesh.ply")
        read = line.split()
        self.assertEqual(read[:4], ["READ", str(len(vertices)), str(len(faces)), "1"])
        self.assertGreater(int(read[4]), 100)

    def test_names_that_are_awkward(self):
        model = adjust_test.Colmap()
        names = ["a b.jpg", "it's \"so\".jpg", "\u00e4\u6f22.jpg", "sub/x.jpg", "5.jpg", "6.jpg"]
        for image, name in zip(model.images, names):
            image["name"] = name
        source = model.write_binary(self.folder / "model")
        result = self.folder / "adjusted"
        done = run("adjust", source, "--out", result, "--quiet")
        self.assertEqual(done.returncode, 0, done.stderr)
        out = self.export("--format", "nerfstudio", source=result)
        frames = json.loads((out / "transforms.json").read_text())["frames"]
        self.assertEqual([frame["file_path"] for frame in frames], ["images/" + name for name in names])
        self.assertEqual(list(read_images_bin(self.export("--format", "colmap", source=result) / "sparse/0/images.bin")), names)
        bundler = self.export("--format", "bundler", source=result)
        self.assertEqual((bundler / "list.txt").read_text().splitlines(), names)

    def test_refused(self):
        self.refused("export", self.folder, "--format", "tum", says=["report.json", "no such file"])
        self.refused("export", OUT, "--format", "fbx", says=["--format: fbx", "colmap, nerfstudio"])
        self.refused("export", OUT, "--format", "tum", "--undistort", says=["--format tum"])
        self.refused("export", OUT, "--format", "tum", "--world", 3, says=["--world: 3", "0 to 0"])
        self.refused("export", OUT, "--format", "tum", "--out", OUT, says=["--out", "folder of a result"])
        self.refused("export", OUT, "--format", "colmap", "--all-frames", says=["--images"])
        half = self.folder / "half"
        shutil.copytree(OUT, half)
        (half / "points.ply").write_bytes((half / "points.ply").read_bytes()[:-7])
        self.refused("export", half, "--format", "tum", says=["points.ply"])
        (half / "report.json").write_text('{"command": "track"')
        self.refused("export", half, "--format", "tum", says=["report.json: not the report of a run"])
        self.assertFalse((self.folder / "half-tum").exists())


if __name__ == "__main__":
    program.main()
