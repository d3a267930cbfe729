"""Methods trained for the same seconds: what is cut and stretched, and that a training taken up keeps to its steps."""

import pandas as pd
import pytest
from balls import photographed

from baselines.method import find_method
from baselines.splatting_profiles import PROFILES
from benchmarks import methods
from benchmarks.methods import METHODS, Course, curves, in_steps


@pytest.mark.parametrize("steps", [150, 20_000])
@pytest.mark.parametrize("name", METHODS)
def test_settings_of_every_method_are_for_so_many_steps(name, steps):
    usual = find_method(name).configuration("demo")
    settings = in_steps(usual, steps)
    trained = getattr(settings, "splatting", getattr(settings, "volumetric", settings))
    assert trained.iterations == steps
    assert type(settings) is type(usual)


def test_growth_begins_and_ends_with_the_schedule():
    usual = PROFILES["demo"]
    short, long = in_steps(usual, usual.iterations // 10), in_steps(usual, 2 * usual.iterations)
    assert short.strategy.start == usual.strategy.start // 10
    assert short.strategy.stop == usual.strategy.stop // 10
    assert long.strategy.start == usual.strategy.start  # nothing is gained by waiting
    assert long.strategy.stop == 2 * usual.strategy.stop


def test_a_training_taken_up_keeps_to_its_steps(tmp_path, monkeypatch):
    monkeypatch.setattr(methods, "PROBE", 10)
    scene = photographed(tmp_path)
    course = Course(scene, scene, "demo", 0, tmp_path / "course")
    speed = course.probe("3dgs")
    assert speed > 0
    row = course.row("3dgs", seconds=1, speed=40)
    again = course.row("3dgs", seconds=1, speed=1000)
    assert row["steps"] == again["steps"] == 40
    assert row["PSNR"] == again["PSNR"]
    assert row["train s"] == again["train s"] <= row["fit s"]
    assert "3dgs" in curves(pd.DataFrame([row]))
