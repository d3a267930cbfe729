import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from kept_blender import needs_blender
from processes import PATIENCE, wait_until
from scipy.special import gamma

from hydroviews.blender.embedded_scenes import captures, textures, textures_indoor
from hydroviews.blender.embedded_scenes.camera_paths import place_cameras
from hydroviews.blender.embedded_scenes.captures import EMBEDDED, read_embedded, render_embedded
from hydroviews.blender.embedded_scenes.embedded import DESIGNS
from hydroviews.blender.embedded_scenes.looks import LOOKS
from hydroviews.blender.embedded_scenes.meshes import Mesh, box, gable, joined, lathe, moved, pillow, prism, sphere
from hydroviews.blender.embedded_scenes.pieces import Lamp, Piece
from hydroviews.blender.embedded_scenes.room import BACK, FRONT, HALF_WIDTH, HEIGHT
from hydroviews.blender.process import run_blender
from hydroviews.errors import InputError
from hydroviews.files import ownership
from hydroviews.files.ownership import FILES
from hydroviews.scene.depth import view_depth
from hydroviews.scene.scenes import TEST_EVERY, no_points

SIZE = (64, 48)
VIEWS = 3


@pytest.fixture
def fake_bpy(tmp_path, monkeypatch):
    """Puts a module of the given text in bpy's place, for processes started from here."""

    def install(text: str) -> None:
        (tmp_path / "modules").mkdir()
        (tmp_path / "modules" / "bpy.py").write_text(textwrap.dedent(text))
        monkeypatch.setenv("PYTHONPATH", str(tmp_path / "modules"))

    return install


MISSING = "raise ModuleNotFoundError(\"No module named 'bpy'\", name='bpy')"
BROKEN = "raise ImportError('libXrender.so.1: cannot open shared object file: No such file or directory')"
DYING = """
import os, signal
os.write(1, b"terminate called\\n")
os.kill(os.getpid(), signal.SIGABRT)
"""


@pytest.mark.parametrize(
    ("bpy", "module", "message"),
    [
        (MISSING, "bake_drops", r"(?s)bpy is not installed.*3\.11.*make setup"),
        (BROKEN, "bake_drops", r"(?s)libXrender\.so\.1.*apt-get install.*libxrender1"),
        (DYING, "bake_drops", r"(?s)SIGABRT.*terminate called.*run the same command again"),
        ("", "no_such_module", r"(?s)status 1.*no_such_module"),
    ],
    ids=["no bpy", "no system library", "dies", "fails"],
)
def test_what_stops_a_process_is_told(fake_bpy, tmp_path, bpy, module, message):
    fake_bpy(bpy)
    with pytest.raises(InputError, match=message):
        run_blender(module, {}, tmp_path / "log", "test")
    assert ("terminate called" in (tmp_path / "log").read_text()) == (bpy == DYING)


def test_the_log_is_removed_with_the_folder_it_lies_in(fake_bpy, tmp_path):
    """It was in the way of a build with other settings."""
    ownership.claim(tmp_path)
    fake_bpy(MISSING)
    log = tmp_path / "work" / "blender.log"
    with pytest.raises(InputError):
        run_blender("bake_drops", {}, log, "test")
    assert log.is_file()
    ownership.clear(log.parent)
    assert not log.parent.exists()


def test_an_interrupted_call_ends_its_process(fake_bpy, tmp_path):
    path = tmp_path / "pid"
    fake_bpy(f"""
        import os, signal, time
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        with open({str(path)!r}, "w") as file:
            file.write(str(os.getpid()) + " ")
        time.sleep(60)
    """)
    call = f"from pathlib import Path; from hydroviews.blender.process import run_blender; \
        run_blender('bake_drops', {{}}, Path({str(tmp_path / 'log')!r}), 'test')"
    caller = subprocess.Popen([sys.executable, "-c", call], stderr=subprocess.PIPE)
    wait_until(lambda: path.exists() and path.read_text().endswith(" "), caller)
    caller.send_signal(signal.SIGINT)
    assert caller.wait(PATIENCE) != 0
    caller.stderr.close()
    with pytest.raises(ProcessLookupError):
        os.kill(int(path.read_text()), 0)


@pytest.mark.parametrize("name", EMBEDDED)
@pytest.mark.parametrize("n_views", [3, 8, 9, 17, 24, 40, 100])
def test_held_out_views_lie_between_two_training_views(n_views, name):
    path = DESIGNS[name].path
    centres = np.array([camera.centre for camera in place_cameras(path, n_views, 64, 48, 0)])
    held_out = np.arange(n_views) % TEST_EVERY == 0
    angles = np.arctan2(*(centres[:, :2] - path.centre).T[::-1])
    for centre, angle in zip(centres[held_out], angles[held_out], strict=True):
        ahead = (angles[~held_out] - angle) % (2 * np.pi)
        before, after = centres[~held_out][[np.argmax(ahead), np.argmin(ahead)]]
        chord = np.linalg.norm(before - after)
        # Nearly on the line between them: within the path's curvature.
        assert np.linalg.norm(centre - (before + after) / 2) < 0.15 * chord + 0.01
    assert len(np.unique(centres.round(6), axis=0)) == n_views


def volume(mesh: Mesh) -> float:
    """By the divergence theorem, faces cut into triangles."""
    corners = [(f[0], f[i], f[i + 1]) for f in mesh.faces for i in range(1, len(f) - 1)]
    return float(np.linalg.det(mesh.vertices[np.array(corners)]).sum() / 6)


@pytest.mark.parametrize(
    ("mesh", "expected"),
    [
        (box(1, 2, 3), 6),
        (moved(box(1, 2, 3), (4, 5, 6), 0.7, 0.2), 6),
        (joined(box(1, 1, 1), moved(box(2, 1, 1), (5, 0, 0))), 3),
        (gable(2, 3, 1), 3),
        (prism([(0, 0), (2, 0), (1, 1)], 3), 3),
        (pillow(2, 4, 6), 6 * 8 * gamma(1.25) ** 3 / gamma(1.75)),  # x^4 + y^4 + z^4 = 1, stretched
        (sphere(1.5), 4 / 3 * np.pi * 1.5**3),
        (lathe([(1, 0), (1, 2)], 90), 2 * np.pi),
        (lathe([(1, 0), (2, 0), (2, 1), (1, 1)], 90, closed=True), 3 * np.pi),
    ],
)
def test_solids_are_closed_and_face_outwards(mesh, expected):
    assert volume(mesh) == pytest.approx(expected, rel=0.02)
    edges = [(face[i - 1], face[i]) for face in mesh.faces for i in range(len(face))]
    assert sorted(edges) == sorted((b, a) for a, b in edges)


PATTERNS = [textures.bricks(8, 4), textures.stones(60), textures.planks(5), textures.shingles(8, 8), textures.checks(6)]
PATTERNS += [textures.stripes(5), textures.rough()]
PATTERNS += [textures_indoor.parquet(4, 5), textures_indoor.damask(4), textures_indoor.plaid(5)]


@pytest.mark.parametrize("pattern", PATTERNS)
def test_textures_tile_and_use_their_colours(pattern):
    texture = pattern(np.random.default_rng(0), np.array([0.2, 0.1, 0.05]), np.array([0.9, 0.6, 0.3]))
    for values in (texture.colour, texture.height):
        assert 0 <= values.min() <= values.max() <= 1
        for axis in (0, 1):
            steps = np.abs(np.diff(values, axis=axis, append=np.take(values, [0], axis)))
            means = steps.mean(axis=tuple(i for i in range(values.ndim) if i != axis))
            assert means[-1] <= means[:-1].max() * 1.1 + 1e-9  # the seam is no stronger than the pattern's own edges
    assert texture.colour.std() > 0.03


def made(name: str, seed: int = 0) -> list[Piece | Lamp]:
    """All that is in a scene."""
    return list(DESIGNS[name].make(np.random.default_rng(seed)))


@pytest.mark.parametrize("name", EMBEDDED)
def test_the_same_seed_builds_the_same_scene(name):
    first, second, other = (made(name, seed) for seed in (0, 0, 1))
    assert [thing.name for thing in first] == [thing.name for thing in second]
    assert len({thing.name for thing in first}) == len(first)
    pairs = [both for both in zip(first, second, strict=True) if isinstance(both[0], Piece)]
    for one, two in pairs:
        assert np.array_equal(one.mesh.vertices, two.mesh.vertices)
        assert (one.position, one.turn, one.material) == (two.position, two.turn, two.material)
    vertices = {thing.name: thing.mesh.vertices for thing in other if isinstance(thing, Piece)}
    assert any(not np.array_equal(one.mesh.vertices, vertices.get(one.name)) for one, _ in pairs)


def eyes_of(name: str) -> np.ndarray:
    """Places of the cameras of three seeds [N, 3]."""
    return np.array([c.centre for seed in range(3) for c in place_cameras(DESIGNS[name].path, 60, 64, 48, seed)])


@pytest.mark.parametrize("name", EMBEDDED)
def test_no_camera_is_inside_anything_and_all_materials_are_known(name):
    around = ("cobbles", "lawn", "hills", "paving", "land", "panelling")  # ground, and what runs along the walls
    eyes = eyes_of(name)
    for piece in (thing for thing in made(name) if isinstance(thing, Piece)):
        vertices = moved(piece.mesh, piece.position, piece.turn).vertices
        inside = np.all((eyes > vertices.min(axis=0) - 0.2) & (eyes < vertices.max(axis=0) + 0.2), axis=1)
        assert piece.name in around or not inside.any(), piece.name
        assert piece.material in LOOKS


def test_cameras_stay_in_the_room_or_just_outside_its_glass():
    eyes = eyes_of("room")
    assert np.all(np.abs(eyes[:, 0]) < HALF_WIDTH - 0.3)
    assert np.all((eyes[:, 1] > FRONT - 0.5) & (eyes[:, 1] < BACK - 0.3))
    assert np.all((eyes[:, 2] > 0.8) & (eyes[:, 2] < HEIGHT - 0.3))


@pytest.fixture(scope="module", params=EMBEDDED)
def capture(request, tmp_path_factory, kept_blender):
    """The name and the folder of a small capture."""
    folder = tmp_path_factory.mktemp(request.param)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(captures, "run_blender", kept_blender)
        render_embedded(request.param, folder, VIEWS, *SIZE, seed=5)
    return request.param, folder


def files(folder: Path) -> dict[str, bytes]:
    """All but logs and lists of what was written, by name."""
    found = [path for path in folder.rglob("*") if path.is_file() and path.suffix != ".log" and path.name != FILES]
    return {str(path.relative_to(folder)): path.read_bytes() for path in found}


@needs_blender
def test_points_project_to_the_pixels_and_depths_they_were_taken_from(capture):
    scene = read_embedded(*capture)
    assert [view.name for view in scene.views] == ["000", "001", "002"]
    assert scene.split.test == ("000",)
    assert len(scene.points) > 4000
    assert scene.metres_per_unit == 1
    error, depth_error = np.full((2, len(scene.points)), np.inf)
    for view in scene.views:
        image, depths = np.round(view.image() * 255), view_depth(view, no_points())
        pixel, depth = view.camera.project(scene.points.positions)
        column, row = np.clip(np.floor(pixel).astype(int), 0, np.array(SIZE) - 1).T
        same = np.all(image[row, column] == scene.points.colours, axis=1) & (depth > 0)
        away = np.where(same, np.linalg.norm(pixel - np.stack([column, row], -1) - 0.5, axis=1), np.inf)
        depth_error = np.where(away < error, np.abs(depths[row, column] / depth - 1), depth_error)
        error = np.minimum(away, error)
    assert error.mean() < 0.002
    assert error.max() < 0.02
    assert np.median(depth_error) < 1e-6
    assert np.quantile(depth_error, 0.99) < 1e-3  # a few points meet a like pixel of another view by chance


@needs_blender
def test_pictures_are_well_exposed_and_full_of_texture(capture):
    darkest, brightest = {"courtyard": (0.3, 0.6), "street": (0.23, 0.4)}.get(capture[0], (0.3, 0.5))
    for view in read_embedded(*capture).views:
        image = view.image()
        assert darkest < image.mean() < brightest
        assert (image >= 1).all(axis=2).mean() < 0.03
        assert np.abs(np.diff(image, axis=1)).mean() > 0.03
        if capture[0] == "street":  # lamps saturate and light their surroundings
            assert 0.002 < (image >= 1).any(axis=2).mean() < 0.08
            assert np.median(image) < 0.35


@needs_blender
def test_only_sky_is_infinitely_far(capture):
    name, folder = capture
    farthest = {"courtyard": 70, "room": 50, "street": 150, "pond": 90, "market": 25}[name]
    for view in read_embedded(name, folder).views:
        depth = view_depth(view, no_points())
        near = np.isfinite(depth)
        assert 0.6 < near.mean() <= 1
        assert depth[near].min() > 0.4
        assert depth[near].max() < farthest
        assert near[-1].all()  # the ground
        if name == "room":  # but for the window
            assert near.mean() > 0.9


@pytest.mark.parametrize("capture", ["room"], indirect=True)  # lit by the sun, lamps and windows: no other has all
@needs_blender
def test_an_interrupted_capture_is_unfinished_and_resumes_to_the_same_bytes(capture):
    name, folder = capture
    whole = files(folder)
    kept = (folder / "images" / "000.png").stat().st_mtime_ns
    for lost in ("images/001.png", "depth/002.exr", "points.npz", "cameras.json"):
        (folder / lost).unlink()
    with pytest.raises(InputError, match=r"no cameras\.json"):
        read_embedded(name, folder)
    render_embedded(name, folder, VIEWS, *SIZE, seed=5)  # in another process, in another order
    assert files(folder) == whole
    assert (folder / "images" / "000.png").stat().st_mtime_ns == kept


@needs_blender
def test_a_finished_capture_is_left_alone_and_another_request_starts_over(capture, monkeypatch):
    name, folder = capture
    monkeypatch.setattr(captures, "run_blender", pytest.fail)
    render_embedded(name, folder, VIEWS, *SIZE, seed=5)
    before, asked = files(folder), []
    monkeypatch.setattr(captures, "run_blender", lambda module, request, log, label: asked.append(files(folder)))
    render_embedded(name, folder, VIEWS, *SIZE, seed=6)
    assert not [path for path in asked[0] if path != "request.json"]
    for path, content in before.items():  # what later tests find
        (folder / path).write_bytes(content)


@pytest.mark.parametrize("request_", [(2, 64, 48, 0), (3, 0, 48, 0), (3, 64, 0, 0), (3, 64, 48, -1)])
def test_a_capture_needs_three_views_and_a_pixel(tmp_path, request_):
    with pytest.raises(InputError, match="at least three views"):
        render_embedded("room", tmp_path, *request_)


def test_an_unknown_embedded_scene_names_the_known_ones(tmp_path):
    with pytest.raises(InputError, match=r"cellar.*(?s:.*)courtyard, room, street"):
        render_embedded("cellar", tmp_path, 3, 64, 48, 0)
