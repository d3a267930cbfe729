"""A wiped lens in focus through build and verification: two sizes of picture, interrupted and resumed."""

from dataclasses import replace

import pytest
from kept_blender import bakes
from synthetic import capture_in

from hydroviews.dataset import rainy_variant
from hydroviews.dataset.build import build
from hydroviews.dataset.checks.verify import verify
from hydroviews.rain.registry import parse_pattern
from hydroviews.scene.images import read_image, write_png
from hydroviews.scene.scenes import make_scene

WIPED = """
from hydroviews.rain.lens.effect import SharpRaindropEffect


class Wiped(SharpRaindropEffect):
    renewed = 1.0
"""


@bakes
def test_an_interrupted_build_of_two_sizes_goes_on_and_verifies(tmp_path, monkeypatch):
    monkeypatch.setattr("hydroviews.rain.lens.renewed.LENSES", 1)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "wiped_in_focus.py").write_text(WIPED)
    scene = capture_in(tmp_path / "capture" / "yard")
    views = [replace(v, camera=v.camera.resized(*((48, 36), (40, 30))[i % 2])) for i, v in enumerate(scene.views)]
    several, rain = make_scene("yard", views, scene.points), parse_pattern("wiped_in_focus:Wiped-0")

    def until_the_third(path, image):
        if path.stem == views[2].name:
            raise KeyboardInterrupt
        write_png(path, image)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(rainy_variant, "write_png", until_the_third)
        build(several, tmp_path / "data", patterns=[rain])
    folder = build(several, tmp_path / "data", patterns=[rain])
    assert verify(tmp_path / "data", every_view=True) == []
    images = folder / rain.name / "images"
    sizes = [read_image(images / f"{view.name}.png").shape[:2] for view in views]
    assert sizes == [(36, 48), (30, 40)] * 4 + [(36, 48)]
    first = images / f"{views[0].name}.png"
    first.chmod(0o644)
    write_png(first, read_image(folder / "clean" / first.name))  # without the blur
    assert any("differs by" in problem for problem in verify(tmp_path / "data", every_view=True))
