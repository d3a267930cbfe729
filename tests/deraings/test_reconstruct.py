"""From photographs to a scene in one call: everything is there, and what is there is not made again."""

import shutil
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import PIL.Image
import pytest
from captures import flower_walk, rained_on
from splats import photographed
from trainings import CONFIG

from baselines.gaussian_splatting import FOUND
from baselines.rendering.film import FilmChoice
from baselines.splatting.files.ply import SPLATS, read_ply
from baselines.training import devices
from deraings import reconstruct as module
from deraings.enhancement.enhance import enhance
from deraings.method import DeRainGSConfig, DeRainGSPlus
from deraings.rain_model.config import RainConfig
from deraings.reconstruct import FILM, SHEET, TRAINING, Reconstruction, find_scene, reconstruct, recorded_settings
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json
from hydroviews.files.locks import locked_if_free
from hydroviews.formats.read import read_scene
from hydroviews.formats.writers import write_colmap
from hydroviews.profiles import find_profile
from hydroviews.scene.images import read_image, write_png
from hydroviews.scene.scenes import Points, no_points

BRIEF = FilmChoice(seconds=0.2, fps=10, size=32)


class Short(DeRainGSPlus):
    """The method, in 60 iterations, of falling rain: a ball in the middle of all pictures stays like drops and mist."""

    profiles = {"demo": DeRainGSConfig(replace(CONFIG, iterations=60), rain=RainConfig(mist=None, drops=None))}  # noqa: RUF012


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    folder = tmp_path_factory.mktemp("capture")
    scene = photographed(folder / "images")
    for view in scene.views:
        view.path.rename(view.path.with_name(f"{view.name}.png"))
    write_colmap(scene, folder / "sparse" / "0")
    return folder


@pytest.fixture(scope="module")
def request_of(capture, tmp_path_factory):
    request = Reconstruction(capture, tmp_path_factory.getbasetemp() / "scene", "short", "demo", film=BRIEF)
    return partial(replace, request)


@pytest.fixture(autouse=True)
def found_by_name(monkeypatch):
    monkeypatch.setattr(module, "find_method", {"short": Short}.__getitem__)


def test_the_profile_for_a_gpu_is_warned_of_before_hours_of_work(request_of, tmp_path, monkeypatch, caplog):
    def cameras(*_):
        assert ["paper is made for a GPU" in record.message for record in caplog.records] == [True]
        raise InputError("far enough")

    devices._warn_once.cache_clear()
    monkeypatch.setitem(Short.profiles, "paper", Short.profiles["demo"])
    monkeypatch.setattr(module, "find_scene", cameras)
    with pytest.raises(InputError, match="far enough"):
        reconstruct(request_of(profile="paper", out=tmp_path / "scene"))


@pytest.mark.parametrize(("own", "expected"), [(96, 96), (None, find_profile("demo").long_side)])
def test_a_size_of_ones_own_comes_before_the_profiles(request_of, tmp_path, monkeypatch, own, expected):
    def resized(long_side):
        raise InputError(f"brought to {long_side}")

    monkeypatch.setattr(module, "find_scene", lambda *_: SimpleNamespace(views=[], notes=[], resized=resized))
    with pytest.raises(InputError, match=f"brought to {expected}$"):
        reconstruct(request_of(out=tmp_path / "scene", long_side=own))


def visible(folder):
    return {path.name for path in folder.glob("[!.]*")}


def test_a_capture_becomes_a_scene_of_all_its_photographs(request_of, caplog):
    with caplog.at_level("INFO"):
        folder = reconstruct(request_of())
    assert visible(folder) == {"reconstruction.json", TRAINING, FILM, SHEET}
    assert len(read_ply(folder / TRAINING / SPLATS)) > 20
    assert read_json(folder / TRAINING / FOUND)["needed"] == []
    assert "found in the photographs: needed nothing" in caplog.text
    sheet = read_image(folder / SHEET)
    assert sheet.shape[1] > 4 * 48
    assert sheet.std() > 0.05
    scene = module.all_views(find_scene(request_of(), folder))
    assert len(scene.train_views) == len(scene.views) == 12
    assert not scene.test_views


def test_the_same_call_ends_with_the_same_scene(request_of):
    folder = reconstruct(request_of())
    before = (folder / TRAINING / SPLATS).read_bytes()
    (folder / FILM).unlink()
    reconstruct(request_of(film=replace(BRIEF, seconds=0.3)))
    assert (folder / FILM).is_file()
    assert (folder / TRAINING / SPLATS).read_bytes() == before
    with pytest.raises(InputError, match="other settings"):
        reconstruct(request_of(seed=1))


def test_cameras_without_points_get_some_once(capture, tmp_path, monkeypatch, caplog):
    scene = read_scene(capture)
    bare, calls = tmp_path / "bare", []
    found = Points(scene.points.positions[:50], scene.points.colours[:50])
    shutil.copytree(capture / "images", bare / "images")
    write_colmap(replace(scene, points=no_points()), bare / "sparse" / "0")
    monkeypatch.setattr(module, "triangulate", lambda scene, folder: calls.append(folder) or found)
    request = Reconstruction(bare)
    first, again = (find_scene(request, tmp_path / "kept") for _ in range(2))
    assert len(calls) == 1
    for points in (first.points, again.points):
        assert np.allclose(np.sort(points.positions, axis=0), np.sort(found.positions, axis=0))
    assert "50 points triangulated" in first.notes[-1]


def test_photographs_without_cameras_have_them_estimated(request_of, tmp_path, monkeypatch):
    for i in range(3):
        write_png(tmp_path / "photographs" / f"{i}.png", np.full((8, 8, 3), 0.1 * i, np.float32))
    asked, walk = [], tmp_path / "walk.mp4"
    monkeypatch.setattr(module, "estimate_poses", lambda *given, **named: asked.append((*given, named)))
    monkeypatch.setattr(module, "capture_video", lambda *given, **named: asked.append((*given, named)) or "scene")
    find_scene(request_of(photographs=tmp_path / "photographs", seed=7), tmp_path / "capture")
    named = {"seed": 7, "rainy": True, "enhance": enhance}
    assert asked.pop() == (tmp_path / "photographs", tmp_path / "capture", named)
    walk.write_bytes(b"film")
    assert find_scene(request_of(photographs=walk, rate=2.0, seed=7), tmp_path / "capture") == "scene"
    ((film, capture, choice, named),) = asked
    assert (film, capture, choice.rate) == (walk, tmp_path / "capture", 2.0)
    assert (named["enhance"], named["seed"]) == (enhance, 7)


def test_rainy_photographs_without_cameras_become_a_scene(tmp_path, monkeypatch, capsys, caplog):
    for i, (name, image) in enumerate(flower_walk()[:6]):
        write_png(tmp_path / "walk" / f"{name}.png", rained_on(image, i))
    config = DeRainGSConfig(replace(CONFIG, iterations=60), rain=RainConfig(), prior="small")
    monkeypatch.setattr(Short, "profiles", {"demo": config})
    request = Reconstruction(tmp_path / "walk", method="short", profile="demo", long_side=96, film=BRIEF)
    with caplog.at_level("INFO"):
        folder = reconstruct(request)
    assert folder == tmp_path / "walk-scene"
    assert visible(folder) == {"capture", "reconstruction.json", TRAINING, FILM, SHEET}
    told = capsys.readouterr().out + caplog.text
    assert "6 of 6 images registered" in told
    assert "found in the photographs: needed" in told
    assert len(read_ply(folder / TRAINING / SPLATS)) > 100


@pytest.mark.parametrize(
    ("photographs", "out", "message"),
    [
        ("empty", "scene", "nothing to reconstruct from"),
        ("nowhere", "scene", "nothing to reconstruct from"),
        ("capture/images/view-00.png", "scene", r"view-00\.png: a picture, not a film"),
        ("capture", "full", "holds other files"),
        ("capture", "capture/images/scene", "among the photographs"),
        ("capture", "data/room/streak-1-scene", r"in the built scene .*/room\n"),
    ],
)
def test_what_cannot_be_reconstructed_is_refused(request_of, capture, tmp_path, monkeypatch, photographs, out, message):
    monkeypatch.setattr("hydroviews.dataset.manifest.scene_entry", lambda folder: {} if folder.name == "room" else None)
    (tmp_path / "capture").symlink_to(capture)
    for folder in ("empty", "full"):
        (tmp_path / folder).mkdir()
    (tmp_path / "full" / "letter.txt").write_text("dear")
    with pytest.raises(InputError, match=message):
        reconstruct(request_of(photographs=tmp_path / photographs, out=tmp_path / out))
    assert out == "full" or not (tmp_path / out).exists()


def test_methods_that_learn_from_clean_views_are_refused(request_of, monkeypatch):
    monkeypatch.setattr(Short, "trains_on", "clean")
    with pytest.raises(InputError, match="learns from clean views"):
        reconstruct(request_of())


@pytest.mark.parametrize("name", ["walk.mp4", "photos", "2024.05.01"])
def test_the_scene_goes_beside_the_photographs(tmp_path, name):
    (tmp_path / "2024.05.01").mkdir()
    assert Reconstruction(tmp_path / name).folder == tmp_path / f"{name.removesuffix('.mp4')}-scene"


@pytest.mark.parametrize(
    ("name", "value"), [("profile", "dmeo"), ("long_side", 0), ("long_side", 5), ("rate", 0.0), ("seed", -1)]
)
def test_settings_that_cannot_be_do_not_take_the_folder(request_of, tmp_path, name, value):
    with pytest.raises(InputError, match=str(value)):
        reconstruct(request_of(out=tmp_path / "scene", **{name: value}))
    assert not (tmp_path / "scene").exists()


def test_a_scene_that_was_moved_is_the_same_scene(request_of, tmp_path):
    here, there = request_of(out=tmp_path / "a"), request_of(out=tmp_path / "b", rate=2.0)
    assert recorded_settings(here) == recorded_settings(there)
    (tmp_path / "walk.mp4").write_bytes(b"film")
    film = request_of(photographs=tmp_path / "walk.mp4")
    assert recorded_settings(film) != recorded_settings(replace(film, rate=2.0))


def test_photographs_that_were_moved_are_gone_on_with(request_of, capture, tmp_path, monkeypatch):
    """Reconstruction ends with its settings and an InputError that tells whether its folder is locked."""

    def look(request, capture):
        with locked_if_free(request.folder) as free:
            raise InputError("nobody waits" if free else "others wait")

    monkeypatch.setattr(module, "find_scene", look)
    for name in ("before", "now"):
        shutil.copytree(capture, tmp_path / name)
    before, now = (request_of(photographs=tmp_path / name, out=tmp_path / "scene") for name in ("before", "now"))
    for request, told in ((before, "others wait"), (now, "other settings")):
        with pytest.raises(InputError, match=told):
            reconstruct(request)
    recorded = recorded_settings(before)
    shutil.rmtree(tmp_path / "before")
    with pytest.raises(InputError, match="others wait"):
        reconstruct(now)
    films = []
    monkeypatch.setattr(module, "draw_film", lambda *given, overwrite: films.append((given[-1], overwrite)))
    monkeypatch.setattr(module, "compared", lambda *_: np.zeros((4, 4, 3), np.float32))
    module.show(SimpleNamespace(summary=lambda: SimpleNamespace(used="")), read_scene(capture), now)
    del recorded["film"]
    assert films == [({"scene": recorded}, True)]  # frames of before are gone on with, those of another film dropped


def test_a_photograph_that_was_mended_and_more_of_them_are_gone_on_with(request_of, tmp_path):
    photographs = [tmp_path / "walk" / f"{i}.png" for i in range(4)]
    random = np.random.default_rng(0)
    for photograph in photographs[:3]:
        write_png(photograph, random.random((64, 64, 3)).astype(np.float32))
    good = photographs[1].read_bytes()
    photographs[1].write_bytes(b"")
    request = request_of(photographs=tmp_path / "walk", out=tmp_path / "scene")
    with pytest.raises(InputError, match=f"{photographs[1]}: cannot be read"):
        reconstruct(request)
    photographs[1].write_bytes(good)
    with pytest.raises(InputError, match="0 of 3 photographs could be registered"):
        reconstruct(request)
    write_png(photographs[3], random.random((64, 64, 3)).astype(np.float32))
    with pytest.raises(InputError, match="0 of 4 photographs could be registered"):
        reconstruct(request)


def test_formats_that_are_not_read_are_named(request_of, tmp_path, caplog):
    for i in range(3):
        (tmp_path / f"{i}.HEIC").write_bytes(b"")
    with pytest.raises(InputError, match=r"found: 3 \.heic\n.*\.png, \.jpg"):
        module.require_photographs(tmp_path)
    write_png(tmp_path / "a.png", np.zeros((4, 4, 3), np.float32))
    with caplog.at_level("INFO"):
        module.require_photographs(tmp_path)
    assert "3 .heic left out" in caplog.text
    (tmp_path / "walk").mkdir()
    for name in "abc":
        PIL.Image.fromarray(np.zeros((4, 4, 3), np.uint8)).save(tmp_path / "walk" / f"{name}.webp")
    with pytest.raises(InputError, match="COLMAP does not read"):
        find_scene(request_of(photographs=tmp_path / "walk"), tmp_path / "capture")
