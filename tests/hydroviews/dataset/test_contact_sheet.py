import numpy as np
import pytest
from commands import command

from hydroviews.dataset.card.contact_sheet import write_sheets
from hydroviews.dataset.checks.verify import verify
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json, write_json
from hydroviews.rain.layers import write_layers
from hydroviews.rain.registry import find_effect
from hydroviews.scene.images import read_image, to_srgb, to_uint8


def holds(sheet, picture) -> bool:
    """True if a picture is somewhere in a sheet, pixel by pixel."""
    height, width = picture.shape[:2]
    corners = np.argwhere((sheet == picture[0, 0]).all(-1))
    return any(np.array_equal(sheet[top : top + height, left : left + width], picture) for top, left in corners)


def pixels(path):
    return to_uint8(read_image(path))


def test_sheets_show_the_views_and_leave_the_scene_as_it_was(built):
    paths = write_sheets(built, columns=3)
    assert [path.name for path in paths] == ["yard.png", "yard-layers.png"]
    assert verify(built.parent) == []
    sheet = pixels(paths[0])
    for name in ("clean/view-01", "clean/view-04", "clean/view-07", "streak-1/images/view-04"):
        assert holds(sheet, pixels(built / f"{name}.png")), name
    assert not holds(sheet, pixels(built / "clean" / "view-00.png"))
    first = [path.read_bytes() for path in paths]
    assert [path.read_bytes() for path in write_sheets(built, columns=3)] == first


@pytest.mark.parametrize(
    ("effect", "planes", "linear"),
    [
        ("raindrop-b", "ER EG EB", False),
        ("shower", "lens.R lens.G lens.B", True),
        ("shower", "storm.R storm.G storm.B", True),
    ],
)
def test_light_that_is_added_is_one_picture_of_three_planes(built, effect, planes, linear):
    """In colour, as the eye sees it; planes of noise are none."""
    light = np.random.default_rng(0).uniform(0.1, 0.9, (36, 48, 3)).astype(np.float16).astype(np.float32)
    layers = {name: np.zeros((36, 48), np.float32) for name in find_effect(effect).planes}
    layers |= {name: light[..., i] for i, name in enumerate(planes.split())}
    (built / "streak-1").rename(built / f"{effect}-1")
    for view in ("view-01", "view-04", "view-07"):
        write_layers(built / f"{effect}-1" / "layers" / f"{view}.exr", layers)
    manifest = read_json(built.parent / "manifest.json")
    manifest["scenes"]["yard"]["patterns"] = [f"{effect}-1"]
    write_json(built.parent / "manifest.json", manifest)
    sheet = pixels(write_sheets(built, columns=3)[1])
    assert holds(sheet, to_uint8(to_srgb(light) if linear else light))


@pytest.mark.parametrize("columns", [0, 400])
def test_sheets_have_some_columns_and_not_too_many(built, columns):
    with pytest.raises(InputError, match="at least 1, at most 40"):
        write_sheets(built, columns=columns)


def test_the_command(built):
    line = ["hydroviews", "sheet", str(built.parent), "--views", "2"]
    done = command(*line)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [str(built.parent / "sheets" / f"yard{end}.png") for end in ("", "-layers")]
    wrong = command(*line, "--scene", "other")
    assert wrong.returncode == 2
    assert "no finished scene other" in wrong.stderr
