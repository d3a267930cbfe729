"""Contact sheets of a built scene: its rain at a glance, and the layers it is made of.

Sheets are for eyes and are no part of the data set: they go to `<data>/sheets`, beside the scenes.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hydroviews.dataset.manifest import read_manifest
from hydroviews.dataset.statistics import STATISTICS, read_statistics
from hydroviews.dataset.variants import has_clean, is_captured
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json
from hydroviews.files.ownership import require_ours
from hydroviews.formats.capture_json import CAPTURED
from hydroviews.rain.compositing import COLOURS, LayerPlane, Layers, light_stems
from hydroviews.rain.layers import read_layers
from hydroviews.rain.patterns import PATTERN_FILE
from hydroviews.rain.registry import find_effect, parse_pattern
from hydroviews.scene.images import Image, list_images, read_image, to_srgb, write_png
from hydroviews.scene.picture_grid import Row, Tile, draw_sheet

if TYPE_CHECKING:
    import pandas as pd

SHEETS = "sheets"
WIDTH = 2000  # pixels of a sheet, at most
COLUMNS = 4
MOST_COLUMNS = 40  # more would leave no room for a picture
GAINS = (1, 2, 4, 8, 16)
LIGHT = "light they add"


def write_sheets(folder: Path, out: Path | None = None, columns: int = COLUMNS) -> list[Path]:
    """Draw the contact sheets of a finished scene.

    Args:
        folder: of the built scene.
        out: where they go; `sheets` beside the scene by default.
        columns: number of views, spread evenly over the capture.

    Returns:
        `<scene>.png`, a row a variant with the clean views first, and, where rain was added, `<scene>-layers.png`.

    Raises:
        InputError: no view is asked for or too many, a file of the scene is missing or damaged, or somebody else's
            file has the name of a sheet.
    """
    if not 1 <= columns <= MOST_COLUMNS:
        raise InputError(f"--views {columns}", expected=f"at least 1, at most {MOST_COLUMNS}")
    out = out or folder.parent / SHEETS
    patterns = read_manifest(folder.parent)["scenes"][folder.name]["patterns"]
    split = read_json(folder / "split.json")
    views = sorted([*split["train"], *split["test"]])
    names = spread(views, columns)
    sheets = {out / f"{folder.name}.png": (_rain_rows(folder, patterns, names), f"{len(names)} of {len(views)} views")}
    if patterns:
        middle = names[len(names) // 2]
        sheets[out / f"{folder.name}-layers.png"] = (
            _layer_rows(folder, patterns, middle),
            f"what was added to {middle}",
        )
    require_ours(sheets)
    for path, (rows, remark) in sheets.items():
        write_png(path, draw_sheet(folder.name, remark, rows, WIDTH))
    return list(sheets)


def spread(names: Sequence[str], count: int) -> list[str]:
    """At most `count` names, from the middles of equal parts of the list."""
    count = min(count, len(names))
    return [names[int((i + 0.5) * len(names) / count)] for i in range(count)]


def _rain_rows(folder: Path, patterns: Sequence[str], names: Sequence[str]) -> list[Row]:
    rows = []
    for title, remark in (("clean", ""), (f"{CAPTURED}/images", "photographed in rain")):
        if (folder / title).is_dir():
            shown = _names_in(folder, title, names)
            rows.append(Row(title.partition("/")[0], remark, [Tile(_picture(folder / title, n), n) for n in shown]))
    for pattern in patterns:
        views = _statistics(folder / pattern / STATISTICS, names)
        tiles = [
            Tile(_picture(folder / pattern / "images", name), f"{name}  {_number(views.at[name, 'psnr'])} dB")
            for name in names
        ]
        rows.append(Row(pattern, _remark(folder / pattern, views), tiles))
    return rows


def _names_in(folder: Path, images: str, names: Sequence[str]) -> Sequence[str]:
    """The names, or as many others where rainy and clean photographs are of different views."""
    if not (is_captured(folder) and has_clean(folder)):
        return names
    there = [path.stem for path in list_images(folder / images)]
    return names if set(names) <= set(there) else spread(there, len(names))


def _statistics(path: Path, names: Sequence[str]) -> "pd.DataFrame":
    """The statistics of a variant by view; those of the views to be shown must be there."""
    views = read_statistics(path).set_index("view")
    absent = [name for name in names if name not in views.index]
    if absent:
        raise InputError(f"{path}: no row for {absent[0]}", found=f"{len(views)} rows", fix="delete it and build again")
    return views


def _remark(variant: Path, views: "pd.DataFrame") -> str:
    """Grade, input PSNR and cover in a line."""
    from hydroviews.rain.streaks.measures import mean_angle

    grade = read_json(variant / PATTERN_FILE).get("grade", "")
    parts = [grade, f"input {_number(views['psnr'].mean())} dB"]
    for column in ("water", "mist", "streaks"):
        if views[column].notna().any() and views[column].max() > 0:
            parts.append(f"{column} {100 * views[column].mean():.1f} %")
    angles = views["angle"].dropna().to_numpy()
    parts += [f"falling at {mean_angle(angles):.0f} degrees"] if len(angles) else []
    return "   ".join(part for part in parts if part)


def _layer_rows(folder: Path, patterns: Sequence[str], name: str) -> list[Row]:
    rows = []
    for pattern in patterns:
        layers = read_layers(folder / pattern / "layers" / f"{name}.exr")
        tiles = [Tile(_picture(folder / pattern / "images", name), "rainy view")]
        planes = find_effect(parse_pattern(pattern).effect).planes
        shown = {key: plane.title for key, plane in planes.items() if plane.title and key in layers}
        tiles += [_plane_tile(layers[key], f"{key}: {title}") for key, title in shown.items()]
        tiles += [_light_tile(layers, stem, planes[f"{stem}R"]) for stem in light_stems(planes)]
        rows.append(Row(pattern, read_json(folder / pattern / PATTERN_FILE).get("grade", ""), tiles))
    return rows


def _light_tile(layers: Layers, stem: str, plane: LayerPlane) -> Tile:
    """Three planes as one picture: what has no largest value is linear light, the rest encoded values."""
    picture = np.stack([layers[stem + channel] for channel in COLOURS], axis=-1)
    name = stem if stem[-1:].isalpha() else f"{stem}RGB"
    return Tile(to_srgb(picture) if np.isinf(plane.most) else picture, f"{name}: {LIGHT}")


def _plane_tile(plane: np.ndarray, words: str) -> Tile:
    """A plane in grey, made brighter by a power of two where it is too faint to be seen, which its caption says."""
    brightest = float(np.percentile(plane, 99))
    gain = next(gain for gain in GAINS if gain * brightest >= 0.5 or gain == GAINS[-1]) if brightest > 0 else 1
    caption = words + (f" (x{gain})" if gain > 1 else "")
    return Tile(np.repeat(np.clip(gain * plane, 0, 1)[..., None], 3, axis=2), caption)


def _picture(images: Path, name: str) -> Image:
    return read_image(images / f"{name}.png")


def _number(value: Any) -> str:
    return f"{float(value):.1f}"
