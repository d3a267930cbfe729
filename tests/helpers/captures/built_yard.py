"""A small data set with two kinds of streaks, built from a capture that says where it comes from."""

from pathlib import Path

from synthetic import capture_in

from hydroviews.dataset.build import build
from hydroviews.rain.patterns import Pattern

STREAKS = (Pattern("streak", 0), Pattern("streak", 2))


def built_yard(folder: Path) -> Path:
    """The scene, built in `folder/data` from `folder/capture/yard`."""
    capture = folder / "capture" / "yard"
    scene = capture_in(capture)
    (capture / "SOURCE.md").write_text("# From a garden\nLicence: CC-BY\n")
    return build(scene, folder / "data", patterns=STREAKS, seed=5, source=str(capture))
