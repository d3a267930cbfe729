"""The data card of a built scene, `<scene>/README.md`: what it is, how hard it is, where it came from.

Everything in it is read from the scene's own files, so that the same files give the same card. Losses of plain 3DGS are
taken from a results folder once there are runs, and kept in `losses.csv` beside the card; both are files of the scene
like others, with their hashes in the manifest.
"""

import math
import shlex
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hydroviews.blender.embedded_scenes.captures import EMBEDDED
from hydroviews.dataset.card.markdown import describe_rain, how_to_open
from hydroviews.dataset.statistics import STATISTICS, read_statistics
from hydroviews.errors import InputError
from hydroviews.files.atomic import is_there, read_json, replacing, write_bytes, write_json
from hydroviews.formats.capture_json import CAPTURED, described_licence
from hydroviews.formats.photographs import FOLDERS
from hydroviews.formats.read import has_cameras
from hydroviews.formats.tables.csv_tables import read_csv
from hydroviews.formats.tables.markdown import markdown_table
from hydroviews.profiles import PROFILES
from hydroviews.rain.patterns import PATTERN_FILE
from hydroviews.scene.images import image_size, list_images
from hydroviews.scene.scenes import Scene

if TYPE_CHECKING:
    import pandas as pd

CARD, LOSSES, LICENCE = "README.md", "losses.csv", "licence"
STATED, APACHE = "licence.json", "Apache-2.0.txt"  # in the folder LICENCE
NOT_QUOTED = (STATED, APACHE)
LICENCE_FILES = ("SOURCE*", "LICENSE*", "LICENCE*", "COPYING*")
MODELLED = "Modelled and rendered by HydroViews with Blender; Apache-2.0, like its code."
SHOWN = {  # heading: column of the statistics, its factor, format and unit
    "input PSNR": ("psnr", 1, "{:.1f}", " dB"),
    "water": ("water", 100, "{:.1f}", " %"),
    "mist": ("mist", 100, "{:.1f}", " %"),
    "streaks": ("streaks", 100, "{:.1f}", " %"),
    "brightness": ("brightness_change", 1, "{:+.3f}", ""),
    "added light": ("added_light", 1, "{:.3f}", ""),
    "angle": ("angle", 1, "{:.0f}", " degrees"),
}


MEASURED = (
    "Means over the views, least and most in brackets. Water, mist and streaks are shares of the picture; brightness "
    "is rainy minus clean in encoded values; added light is linear, 1 is white paper; the angle is measured from the "
    "pixels. Every view's numbers are in each variant's `statistics.csv`."
)


@dataclass(frozen=True)
class Licence:
    """Under which terms a scene's photographs are: an SPDX identifier or a text, who says so, and whether to share."""

    text: str
    shareable: bool  # whether they may be handed on
    said_by: str  # "HydroViews", "the capture", or "who packed it"


def keep_licence(capture: Scene, folder: Path) -> None:
    """Copy the capture's own word on its origin and licence, from its folder and its photographs', to `licence/`.

    Args:
        capture: as read, before it is built.
        folder: of the built scene.

    Raises:
        InputError: see `described_licence`.
    """
    places = _capture_folders(capture.views[0].path)
    for place in places:
        for file in sorted(path for pattern in LICENCE_FILES for path in place.glob(pattern) if path.is_file()):
            with replacing(folder / LICENCE / file.name) as temporary:
                shutil.copyfile(file, temporary)
    stated = stated_licence(capture)
    if stated:
        write_json(folder / LICENCE / STATED, asdict(stated))


def stated_licence(capture: Scene) -> Licence | None:
    """What a capture's `capture.json` says of its licence; None where it says nothing.

    Raises:
        InputError: see `described_licence`.
    """
    stated = described_licence(_capture_folders(capture.views[0].path)[0])
    return Licence(*stated, said_by="the capture") if stated else None


def _capture_folders(photograph: Path) -> list[Path]:
    """From the capture's folder, which has the cameras, down to the photograph's; where none has, the last two."""
    above = list(photograph.parents)
    usual = 1 if above[0].name in FOLDERS else 0
    capture = next((i for i, folder in enumerate(above) if has_cameras(folder)), usual)
    return above[capture::-1]


def find_licence(folder: Path) -> Licence | None:
    """The licence of a built scene's photographs; None where nobody has stated one.

    Raises:
        InputError: its file is not what `keep_licence` writes.
    """
    path = folder / LICENCE / STATED
    if not is_there(path):
        modelled = read_json(folder / "request.json").get("source") in EMBEDDED
        return Licence("Apache-2.0", True, "HydroViews") if modelled else None
    content = read_json(path)
    try:
        return Licence(**content)
    except TypeError as error:
        raise InputError(f"{path}: not a licence", found=error, fix="build the scene again") from None


def write_card(folder: Path, patterns: Sequence[str], notes: Sequence[str] = ()) -> Path:
    """Write the card of a scene whose other files are finished: see `card_text`."""
    path = folder / CARD
    write_bytes(path, card_text(folder, patterns, notes, find_licence(folder)).encode())
    return path


def card_text(folder: Path, patterns: Sequence[str], notes: Sequence[str], licence: Licence | None) -> str:
    """The card of a scene, as far as it consists of these variants.

    Args:
        folder: of the built scene.
        patterns: names of variants.
        notes: what the reader of the capture found worth telling.
        licence: of the photographs; None if it is not known.

    Raises:
        InputError: a file of the scene is missing or unreadable.
    """
    request = read_json(folder / "request.json")
    facts = {name: read_json(folder / name / PATTERN_FILE) for name in patterns}
    parts = [
        _about(folder, request, facts, notes),
        _severity(folder, facts),
        _losses(folder, patterns),
        _origin(folder, request, patterns, licence),
        how_to_open(folder.name, patterns),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _about(folder: Path, request: Mapping[str, Any], facts: Mapping[str, Any], notes: Sequence[str]) -> str:
    split = read_json(folder / "split.json")
    pictures = folder / "clean" if (folder / "clean").is_dir() else next(iter(sorted(folder.glob("*/images"))))
    sizes = sorted({image_size(path) for path in list_images(pictures)})
    size = f"{sizes[0][0]}x{sizes[0][1]}" if len(sizes) == 1 else f"{len(sizes)} sizes, {sizes[0]} to {sizes[-1]}"
    rains = ", ".join(facts) or "none yet"
    rows = [
        ("capture", _display_name(request["source"])),
        ("views", f"{len(split['train']) + len(split['test'])} of {size} pixels"),
        ("split", f"{len(split['train'])} to train on, {len(split['test'])} held out"),
        ("tracks", f"given-poses; sparse-views, with {len(split.get('sparse', []))} of the training views"),
        ("rain", rains),
        ("seed", request["seed"]),
    ]
    lines = [f"# {folder.name}", "", markdown_table(("", ""), rows)]
    if notes:
        lines += ["", *(f"* {note}" for note in notes)]
    return "\n".join(lines)


def _severity(folder: Path, facts: Mapping[str, Any]) -> str:
    """What rain did to the views, a row a variant, and each one's parameters in words."""
    if not facts:
        return ""
    parts = ["## Rain"]
    if is_there(folder / STATISTICS):
        table = read_statistics(folder / STATISTICS).set_index("pattern")
        numbers = [(name, table.loc[[name]].iloc[0]) for name in facts]
        rows = [
            (name, row["grade"], *(_mean_and_range(row, *what) for what in SHOWN.values())) for name, row in numbers
        ]
        parts += [markdown_table(("rain", "grade", *SHOWN), rows), MEASURED]
    words = [
        f"* **{name}**: {describe_rain(fact['effect'], fact.get('parameters', {}))}" for name, fact in facts.items()
    ]
    return "\n\n".join([*parts, "\n".join(words)])


def _mean_and_range(row: "pd.Series", column: str, factor: float, form: str, unit: str) -> str:
    values = [factor * float(row[f"{column}_{what}"]) for what in ("mean", "min", "max")]
    if math.isnan(values[0]):
        return ""
    mean, low, high = (form.format(value) for value in values)
    return f"{mean}{unit}" + (f" ({low} to {high})" if low != high else "")


def _losses(folder: Path, patterns: Sequence[str]) -> str:
    losses = read_csv(folder / LOSSES, keep_default_na=False).to_dict("records") if is_there(folder / LOSSES) else []
    levels = ("clean", "rainy", "loss")
    rows = [
        (row["pattern"], row["grade"], row["track"], *(f"{row[name]:.2f} dB" for name in levels), row["seeds"])
        for row in losses
        if row["pattern"] in patterns
    ]
    if not rows:
        return ""
    head = ("rain", "grade", "track", "trained on clean views", "on rainy views", "loss", "seeds")
    text = "Held-out PSNR of plain 3D Gaussian splatting against the clean views."
    return "\n".join(["## What it costs plain 3DGS", "", text, "", markdown_table(head, rows)])


def _origin(folder: Path, request: Mapping[str, Any], patterns: Sequence[str], licence: Licence | None) -> str:
    source, size = request["source"], request["long_side"]
    path = f"path/to/{_display_name(source)}" if _display_name(source) != source else source
    command = ["hydroviews", "build", path, *_profile(folder)]
    command += ["--long-side", size] if size else []
    command += ["--lens-renderer", request["lens_renderer"]] if request["lens_renderer"] != "disk" else []
    added = [name for name in patterns if name != CAPTURED]
    command += ["--seed", request["seed"], *(["--patterns", *added] if added else [])]
    kept = sorted((folder / LICENCE).glob("[!.]*"))
    words = [f"From `{LICENCE}/{file.name}`:\n\n" + _quoted(file) for file in kept if file.name not in NOT_QUOTED]
    if source in EMBEDDED:
        words = [MODELLED]
    elif licence:
        words.insert(0, f"Licence of the photographs, as stated by {licence.said_by}: {licence.text}")
    elif not words:
        words = ["The photographs' licence is unknown: none lay beside them."]
    made = f"Made by {request['generator']} with\n\n```\n{shlex.join(map(str, command))}\n```"
    return "\n\n".join(["## Origin", made, *words])


def _profile(folder: Path) -> list[str]:
    """Which profile has as many views as an embedded scene: only that says how many are rendered."""
    split = read_json(folder / "split.json")
    count = len(split["train"]) + len(split["test"])
    source = read_json(folder / "request.json")["source"]
    fitting = [profile.name for profile in PROFILES.values() if profile.embedded_views == count]
    return ["--profile", fitting[0]] if source in EMBEDDED and fitting else []


def _display_name(source: str) -> str:
    """A folder's name without the path to it, which is another on every machine."""
    return Path(source).name if Path(source).is_absolute() or source.startswith(".") else source


def _quoted(file: Path) -> str:
    lines = file.read_text(errors="replace").strip().splitlines()
    return "\n".join(f"> {line}".rstrip() for line in lines[:40])
