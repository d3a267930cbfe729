"""What rain did to every view of a variant, measured from its files: `statistics.csv`, a row a view.

    <scene>/<pattern>/statistics.csv   a row a view
    <scene>/statistics.csv             a row a variant: mean, least and most over its views

| column | is |
|---|---|
| water, mist, streaks | mean of the layer planes M, V and S: shares of the picture; of several in one, their union |
| brightness_change | mean of rainy minus clean, encoded values, signed |
| added_light | mean of what pixels gained, in linear light; 1 is white paper |
| psnr | of the rainy view against the clean one, dB |
| angle | of streaks, measured: degrees counter-clockwise from +x, 90 is vertical |
| seed_density | of streaks of the recipe, measured; n / 25600 was asked for |

What a kind of rain does not have is empty.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from hydroviews.errors import InputError
from hydroviews.files.atomic import as_file, read_json
from hydroviews.formats.tables.csv_tables import read_csv, write_csv
from hydroviews.rain.layers import read_layers
from hydroviews.rain.patterns import PATTERN_FILE
from hydroviews.rain.registry import find_effect
from hydroviews.scene.images import list_images, read_image, to_linear, to_uint8

if TYPE_CHECKING:
    import pandas as pd

STATISTICS = "statistics.csv"
LINEAR = to_linear(np.arange(256, dtype=np.float32) / 255)  # of every 8-bit value
DECIMALS = 5


@dataclass(frozen=True)
class ViewStatistics:
    """One rainy view against its clean one; None for what this kind of rain does not have."""

    view: str
    water: float | None
    mist: float | None
    streaks: float | None
    brightness_change: float
    added_light: float
    psnr: float  # infinite where no pixel changed
    angle: float | None
    seed_density: float | None


NUMBERS = [field.name for field in fields(ViewStatistics) if field.name != "view"]
SUMMARY = [f"{name}_{what}" for name in NUMBERS for what in ("mean", "min", "max")]
ANEW = "delete it and build again"


def write_statistics(folder: Path, pattern: str) -> Path:
    """Measure a finished variant and write its `statistics.csv`; what is there is kept.

    Args:
        folder: of the built scene.
        pattern: the variant's name.

    Returns:
        The variant's file.

    Raises:
        InputError: a view or a layer is missing or unreadable, or the disk is full.
    """
    path = folder / pattern / STATISTICS
    if not path.is_file():
        write_csv(path, measure_variant(folder, pattern))
    return path


def write_summary(folder: Path) -> None:
    """Write the scene's `statistics.csv` from those of its variants, all of which are finished; none without variants.

    Raises:
        InputError: a variant's facts or statistics are missing or unreadable, or the disk is full.
    """
    summary = summarise(folder)
    if len(summary):
        write_csv(folder / STATISTICS, summary)


def measure_variant(folder: Path, pattern: str) -> "pd.DataFrame":
    """Statistics of every view of a variant, a row each in order of name, from its files."""
    import pandas as pd

    variant = folder / pattern
    facts = read_json(variant / PATTERN_FILE)
    images = list_images(variant / "images")
    rows = [
        asdict(_measure_files(folder, variant, image, facts))
        for image in tqdm(images, desc=f"{folder.name}: {pattern}, statistics", unit="view", leave=False)
    ]
    return pd.DataFrame(rows, columns=["view", *NUMBERS]).round(DECIMALS)


def _measure_files(folder: Path, variant: Path, image: Path, facts: Mapping[str, Any]) -> ViewStatistics:
    clean = to_uint8(read_image(folder / "clean" / image.name))
    rainy = to_uint8(read_image(image))
    if clean.shape != rainy.shape:
        raise InputError(f"{image}: another size than its clean view", found=rainy.shape, expected=clean.shape)
    layer = variant / "layers" / f"{image.stem}.exr"
    layers = read_layers(layer)
    absent = set(find_effect(facts["effect"]).planes) - set(layers)
    if absent:
        raise InputError(f"{layer}: no plane {', '.join(sorted(absent))}", found=", ".join(layers), fix=ANEW)
    return measure_view(image.stem, clean, rainy, layers, facts)


def measure_view(
    name: str,
    clean: NDArray[np.uint8],
    rainy: NDArray[np.uint8],
    layers: Mapping[str, NDArray[np.float32]],
    facts: Mapping[str, Any],
) -> ViewStatistics:
    """Statistics of one view.

    Args:
        name: of the view.
        clean: [H, W, 3], sRGB-encoded, 0 to 255.
        rainy: the same in rain.
        layers: planes [H, W] by channel name.
        facts: the variant's `pattern.json`: its effect and parameters.
    """
    from hydroviews.rain.streaks.measures import streak_angle

    squared = cv2.norm(rainy, clean, cv2.NORM_L2SQR) / (clean.size * 255**2)
    gained = np.maximum(cv2.LUT(rainy, LINEAR) - cv2.LUT(clean, LINEAR), 0)
    effect = find_effect(facts["effect"])
    shares = {share: float(cover.mean()) for share, cover in effect.covers(layers).items()}
    return ViewStatistics(
        view=name,
        water=shares.get("water"),
        mist=shares.get("mist"),
        streaks=shares.get("streaks"),
        brightness_change=float(rainy.mean() - clean.mean()) / 255,
        added_light=float(gained.mean()),
        psnr=-10 * float(np.log10(squared)) if squared else float("inf"),
        angle=None if effect.falling is None else streak_angle(layers[effect.falling]),
        seed_density=effect.seed_density(facts["parameters"], layers),
    )


def read_statistics(path: Path) -> "pd.DataFrame":
    """The rows of a `statistics.csv`, of a variant or of a scene; what is empty reads as NaN, names stay text.

    Raises:
        InputError: the file is missing, is cut short, or is no such table.
    """

    try:
        text = as_file(path).read_text(encoding="utf-8")
        table = read_csv(StringIO(text), texts=["view", "pattern"])
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not a table of statistics", found=error, fix=ANEW) from None
    expected = ["view", *NUMBERS] if "view" in table else ["pattern", *SUMMARY]
    absent = [name for name in expected if name not in table]
    if absent:
        raise InputError(f"{path}: not a table of statistics", found=f"no column {', '.join(absent)}", fix=ANEW)
    if not text.endswith("\n"):
        raise InputError(f"{path}: cut short", found=f"{len(table)} rows, the last one not to its end", fix=ANEW)
    return table


def summarise(folder: Path, patterns: str = "[!.]*") -> "pd.DataFrame":
    """A scene's variants, a row each: mean, least and most of every number over the views.

    Args:
        folder: of the built scene.
        patterns: a shell pattern of the variants' names; all if not given.
    """
    import pandas as pd

    rows = []
    for path in sorted(folder.glob(f"{patterns}/{STATISTICS}")):
        views, facts = read_statistics(path), read_json(path.parent / PATTERN_FILE)
        about = {"pattern": path.parent.name, "effect": facts["effect"], "grade": facts.get("grade", "")}
        rows.append({**about, "views": len(views), **_summary(views)})
    return pd.DataFrame(rows, columns=["pattern", "effect", "grade", "views", *SUMMARY]).round(DECIMALS)


def _summary(views: "pd.DataFrame") -> dict[str, float]:
    from hydroviews.rain.streaks.measures import mean_angle

    summary: dict[str, float] = {}
    for name in NUMBERS:
        values = views[name].dropna().to_numpy(np.float64)
        mean = mean_angle(values) if name == "angle" else values.mean() if len(values) else np.nan
        if name == "angle":  # 179 and 1 degrees lie beside each other
            values = (values - mean + 90) % 180 - 90 + mean
        least, most = (values.min(), values.max()) if len(values) else (np.nan, np.nan)
        summary |= {f"{name}_mean": mean, f"{name}_min": least, f"{name}_max": most}
    return summary
