import pytest

from hydroviews.rain.lens.optics import bake


@pytest.fixture
def kept(monkeypatch, kept_blender):
    """Bakes are made by one Blender process, where the test is not about processes."""
    monkeypatch.setattr(bake, "run_blender", kept_blender)
