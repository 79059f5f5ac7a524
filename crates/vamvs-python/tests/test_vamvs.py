"""The package as a program uses it, on drawn photographs of a wall 4 m away."""

import os
import signal
import struct
import subprocess
import sys

import numpy as np
import pytest

import vamvs

DISTANCE = 4.0
WIDTH, HEIGHT = 192, 144
K = np.array([[180.0, 0, WIDTH / 2], [0, 180.0, HEIGHT / 2], [0, 0, 1]])
EYES = [(0.25 * (n % 2), 0.25 * (n // 2), 0.0) for n in range(4)]
# The handcrafted network: small, and the same on every machine.
QUICK = {"weights": "photometric", "planes": 32}


def photograph(eye):
    x = eye[0] + (np.arange(WIDTH) + 0.5 - K[0, 2]) / K[0, 0] * DISTANCE
    y = eye[1] + (np.arange(HEIGHT) + 0.5 - K[1, 2]) / K[1, 1] * DISTANCE
    x, y = np.meshgrid(x, y)
    waves = [(23.0, 7.0, 2.0), (-9.0, 31.0, 3.0), (41.0, 37.0, 1.0)]
    channels = [128 + 100 * np.sin(a * x + b * y + c * np.sin(3 * x * y)) for a, b, c in waves]
    return np.stack(channels, axis=-1).astype(np.uint8)


def pose(eye):
    return np.hstack([np.eye(3), -np.array(eye).reshape(3, 1)])


@pytest.fixture(scope="module")
def scene():
    count = len(EYES)
    return vamvs.Scene.from_arrays([photograph(eye) for eye in EYES], [K] * count, [pose(eye) for eye in EYES])


@pytest.fixture(scope="module")
def maps(scene):
    return list(scene.depth_maps(**QUICK))


def write_bmp(path, image):
    rows = image[::-1, :, ::-1].tobytes()
    header = struct.pack("<2sIHHIIiiHHIIiiII", b"BM", 54 + len(rows), 0, 0, 54, 40, WIDTH, HEIGHT, 1, 24, 0, len(rows), 0, 0, 0, 0)
    path.write_bytes(header + rows)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "cams").mkdir()
    (tmp_path / "images").mkdir()
    for number, eye in enumerate(EYES):
        write_bmp(tmp_path / "images" / f"{number:04}.bmp", photograph(eye))
        rows = [" ".join(map(str, row)) for row in [*pose(eye), [0, 0, 0, 1]]]
        camera = [" ".join(map(str, row)) for row in K]
        text = "\n".join(["extrinsic", *rows, "", "intrinsic", *camera, "", "2 8"])
        (tmp_path / "cams" / f"{number:04}_cam.txt").write_text(text + "\n")
    return tmp_path


def error_of(maps):
    depths = np.concatenate([m.depth[m.depth > 0] for m in maps])
    return np.median(np.abs(depths - DISTANCE))


def test_depth_maps_are_arrays_and_right(scene, maps):
    assert len(scene) == 4 and [m.name for m in maps] == scene.names == ["0000", "0001", "0002", "0003"]
    for m, eye in zip(maps, EYES):
        assert m.depth.shape == m.confidence.shape == (HEIGHT, WIDTH) and m.depth.dtype == np.float32
        assert m.normal.shape == m.colour.shape == (HEIGHT, WIDTH, 3)
        assert np.allclose(m.K, K) and np.allclose(m.cam_from_world, pose(eye))
        assert (m.depth > 0).mean() > 0.9 and 0 <= m.confidence.min() and m.confidence.max() <= 1
        assert np.median(m.normal[m.depth > 0] @ [0, 0, -1]) > 0.99
    assert error_of(maps) < 0.005


def test_maps_of_ones_own_are_fused_like_those_of_vamvs(maps, tmp_path):
    cloud = vamvs.fuse(maps)
    assert len(cloud) > 10000 and cloud.points.shape == (len(cloud), 3) == cloud.colours.shape
    assert np.median(np.abs(cloud.points[:, 2] - DISTANCE)) < 0.005 and cloud.views.min() >= 2
    own = [vamvs.DepthMap(m.name, m.depth, m.K, m.cam_from_world, m.colour, m.confidence, m.normal) for m in maps]
    assert abs(len(vamvs.fuse(own)) / len(cloud) - 1) < 0.02
    cloud.save(tmp_path / "cloud.ply")
    assert f"element vertex {len(cloud)}".encode() in (tmp_path / "cloud.ply").read_bytes()[:200]


def test_maps_become_a_mesh(maps, tmp_path):
    mesh = vamvs.mesh(maps, cell=2)
    assert len(mesh.triangles) > 5000 and mesh.vertices.shape == mesh.normals.shape == mesh.colours.shape
    assert np.median(np.abs(mesh.vertices[:, 2] - DISTANCE)) < 0.005
    assert np.median(mesh.normals[:, 2]) < -0.9, "towards the cameras"
    assert mesh.triangles.max() < len(mesh.vertices)
    assert len(vamvs.mesh(maps, cell=2, triangles=0.2).triangles) < 0.3 * len(mesh.triangles)
    mesh.save(tmp_path / "mesh.glb")
    assert (tmp_path / "mesh.glb").read_bytes()[:4] == b"glTF"
    with pytest.raises(ValueError, match="mesh.stl"):
        mesh.save(tmp_path / "mesh.stl")
    with pytest.raises(vamvs.Error, match="cell: expected 0.25 to 64"):
        vamvs.mesh(maps, cell=0)


def test_a_draft_is_quick_and_other_options_win(scene):
    draft = next(scene.depth_maps(quality="draft", planes=32))
    assert draft.depth.shape == (HEIGHT, WIDTH) and error_of([draft]) < 0.02
    smaller = next(scene.depth_maps(quality="draft", planes=32, weights="photometric", max_size=96))
    assert smaller.depth.shape == (HEIGHT // 2, WIDTH // 2)


def test_masked_pixels_have_no_depth():
    mask = np.ones((HEIGHT, WIDTH), bool)
    mask[:, : WIDTH // 2] = False
    images, poses = [photograph(eye) for eye in EYES], [pose(eye) for eye in EYES]
    scene = vamvs.Scene.from_arrays(images, [K] * 4, poses, names=list("abcd"), masks=[mask, None, None, None])
    first = next(scene.depth_maps(**QUICK))
    assert first.name == "a" and (first.depth[~mask] == 0).all() and (first.depth[mask] > 0).mean() > 0.9


def test_files_in_and_out_with_progress_and_resumption(folder, maps):
    events = []
    given = {"images": folder / "images", "cams": folder / "cams", "out": folder / "out", **QUICK}
    done = vamvs.reconstruct(on_event=events.append, **given)
    assert (done.made, done.resumed, done.left_out) == (4, 0, []) and done.points > 10000
    assert os.path.getsize(done.cloud) > done.points and {"depth_map", "fusion"} <= {e["kind"] for e in events}
    assert vamvs.reconstruct(**given).resumed == 4
    scene = vamvs.Scene.from_mvsnet(folder / "cams", folder / "images")
    assert error_of(list(scene.depth_maps(**QUICK))) < 0.005


def test_numbers_of_numpy_are_options_and_a_tiny_skew_is_none():
    images, poses = [photograph(eye) for eye in EYES], [pose(eye) for eye in EYES]
    skewed = K.copy()
    skewed[0, 1] = 1e-10
    scene = vamvs.Scene.from_arrays(images, [skewed] * 4, poses, names=list("abcd"))
    smaller = {**QUICK, "max_size": np.int64(WIDTH // 2)}
    assert next(scene.depth_maps(**smaller)).depth.shape == (HEIGHT // 2, WIDTH // 2)


def test_no_depth_map_at_all_is_an_error():
    images, poses = [photograph(eye) for eye in EYES], [pose(eye) for eye in EYES]
    scene = vamvs.Scene.from_arrays(images, [K] * 4, poses, masks=[np.ones((3, 3), bool)] * 4)
    with pytest.raises(vamvs.Error, match="no depth map could be made: .*mask"):
        list(scene.depth_maps(**QUICK))


def test_the_caller_ends_the_work(scene):
    with pytest.raises(vamvs.Cancelled, match="cancelled"):
        list(scene.depth_maps(on_event=lambda event: False, **QUICK))

    def fails(event):
        raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        list(scene.depth_maps(on_event=fails, **QUICK))


@pytest.mark.parametrize(
    ("call", "kind", "text"),
    [
        (lambda s: s.depth_maps(wieghts=1), TypeError, "unknown option \"wieghts\""),
        (lambda s: s.depth_maps(views="many"), ValueError, "views: .*many"),
        (lambda s: s.depth_maps(quality="good"), ValueError, "quality: expected .*good"),
        (lambda s: s.depth_maps(roi=(0, 1)), ValueError, "roi: expected"),
        (lambda s: list(s.depth_maps(weights="absent.pt")), vamvs.Error, "absent.pt"),
        (lambda s: list(s.depth_maps(views=1, **QUICK)), vamvs.Error, "views must be at least 2"),
        (lambda s: vamvs.Scene.from_colmap("absent", "images"), vamvs.Error, "absent"),
        (lambda s: vamvs.Scene.from_arrays([np.zeros((4, 4, 3), np.uint8)], [], []), ValueError, "K: expected one"),
        (lambda s: vamvs.Scene.from_arrays([np.zeros((4, 4, 3), np.uint8)], [np.zeros((3, 3))], [np.eye(4)]), ValueError, "K: "),
        (lambda s: vamvs.reconstruct(out="out"), TypeError, "exactly one of colmap"),
        (lambda s: vamvs.fuse([1]), TypeError, "DepthMap"),
        (lambda s: vamvs.nothing, AttributeError, "nothing"),
    ],
)
def test_mistakes_are_told(scene, call, kind, text):
    with pytest.raises(kind, match=text):
        call(scene)


@pytest.mark.skipif(os.name == "nt", reason="signals of another kind")
def test_ctrl_c_is_answered_while_a_depth_map_is_made(folder):
    script = (
        "import sys, time, vamvs\n"
        "try:\n"
        f"    vamvs.reconstruct({str(folder / 'images')!r}, cams={str(folder / 'cams')!r}, out={str(folder / 'out')!r},"
        " on_event=lambda e: print('event', flush=True), weights='vis-max', enlarge=3)\n"
        "except KeyboardInterrupt:\n"
        "    print('interrupted', flush=True)\n"
    )
    # A shell's background jobs, this test perhaps one of them, ignore Ctrl-C, and so would what they start.
    def heed():
        signal.signal(signal.SIGINT, signal.SIG_DFL)

    program = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True, preexec_fn=heed)
    assert program.stdout.readline() == "event\n"
    program.send_signal(signal.SIGINT)
    # Of the seven remaining events at most one, sent before the signal arrived.
    lines = program.stdout.read().splitlines()
    assert lines[-1] == "interrupted" and len(lines) <= 2
    assert program.wait() == 0


def test_a_program_may_end_before_the_last_depth_map(folder):
    script = (
        "import vamvs\n"
        f"scene = vamvs.Scene.from_mvsnet({str(folder / 'cams')!r}, {str(folder / 'images')!r})\n"
        "maps = scene.depth_maps(weights='photometric', planes=32)\n"
        "print(next(maps).name)\n"
    )
    program = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120)
    assert (program.stdout, program.returncode) == ("0000\n", 0), program.stderr


def test_the_command_is_there(folder):
    def run(*arguments):
        command = [sys.executable, "-c", "import vamvs; vamvs._command()", *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True)

    assert run("--version").stdout == f"vamvs {vamvs.__version__}\n"
    failed = run("reconstruct", "--cams", folder / "absent", "--images", folder / "images")
    assert failed.returncode == 1 and "absent" in failed.stderr
    given = ["reconstruct", "--cams", folder / "cams", "--images", folder / "images", "--out", folder / "out", "--quiet"]
    assert run(*given, "--weights", "photometric", "--planes", "32").returncode == 0
    assert (folder / "out" / "fused.ply").is_file()
