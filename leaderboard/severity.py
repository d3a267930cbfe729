"""How much plain 3D Gaussian splatting loses to a scene's rain, taken from a results folder into its data card."""

from pathlib import Path

import pandas as pd

from hydroviews.dataset.card.card import CARD, LOSSES, write_card
from hydroviews.dataset.manifest import data_hash, read_manifest, record_files
from hydroviews.dataset.variants import is_captured
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json, replacing
from hydroviews.formats.capture_json import CAPTURED
from leaderboard.records import LEADERBOARD, SCORED

CEILING, FLOOR = "3dgs-clean", "3dgs"  # plain 3DGS trained on clean and on rainy views
TEXT = ("method", "scene", "pattern", "track", "profile", "status", "data_sha256")  # names, even where they are digits
COLUMNS = ["pattern", "grade", "track", "profile", "seeds", "clean", "rainy", "loss"]


def record_losses(folder: Path, results: Path) -> pd.DataFrame:
    """Take what plain 3DGS loses on each variant from a results folder; writes `losses.csv`, card and manifest.

    Only runs on the data as they are now count.

    Args:
        folder: of a finished scene.
        results: with a `leaderboard.csv`.

    Returns:
        A row a variant and track: mean PSNR over the seeds that have both runs, and the loss, in dB.

    Raises:
        InputError: there is no leaderboard, or no pair of runs on this scene.
    """
    losses = losses_of(folder, _read_leaderboard(results))
    if losses.empty:
        raise InputError(
            f"{results / LEADERBOARD}: no pair of finished runs of {CEILING} and {FLOOR} on {folder.name} as it is now",
            fix="run `make eval METHOD=3dgs` on this scene and profile first",
        )
    with replacing(folder / LOSSES) as temporary:
        losses.to_csv(temporary, index=False)
    rewrite_card(folder)
    return losses


def rewrite_card(folder: Path) -> None:
    """Write the card of a finished scene anew, and its hash into the manifest."""
    notes = read_manifest(folder.parent)["scenes"][folder.name].get("notes", ())
    write_card(folder, _patterns(folder), notes)
    record_files(folder.parent, folder.name, [name for name in (CARD, LOSSES) if (folder / name).is_file()])


def _patterns(folder: Path) -> list[str]:
    """Names of a finished scene's variants."""
    listed: list[str] = read_manifest(folder.parent)["scenes"][folder.name]["patterns"]
    return [CAPTURED] if is_captured(folder) else listed


def _read_leaderboard(results: Path) -> pd.DataFrame:
    path, fix = results / LEADERBOARD, "run `make eval METHOD=3dgs`, or name the folder with --results"
    try:
        table = pd.read_csv(path, converters=dict.fromkeys(TEXT, str))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: no leaderboard", found=error, fix=fix) from None
    absent = {*TEXT, "seed", "psnr"} - set(table)
    if absent:
        raise InputError(f"{path}: no leaderboard", found=f"no column {', '.join(sorted(absent))}", fix=fix)
    return table


def losses_of(folder: Path, leaderboard: pd.DataFrame) -> pd.DataFrame:
    """PSNR of plain 3DGS trained on clean and on rainy views, and the difference: a row a variant and track."""
    data, scene = folder.parent, folder.name
    patterns = _patterns(folder)
    hashes = {pattern: data_hash(data, scene, pattern) for pattern in ("clean", *patterns)}
    runs = leaderboard[(leaderboard.scene == scene) & leaderboard.status.isin(SCORED)]
    runs = runs[runs.data_sha256 == runs.pattern.map(hashes)].dropna(subset=["psnr"])
    same = ["profile", "track", "seed"]
    ceiling = runs[runs.method == CEILING][[*same, "psnr"]]
    floor = runs[runs.method == FLOOR][[*same, "pattern", "psnr"]]
    rows = []
    pairs = floor.merge(ceiling, on=same, suffixes=("", "_clean"))
    for (track, pattern, profile), group in pairs.groupby(["track", "pattern", "profile"]):
        clean, rainy = float(group.psnr_clean.mean()), float(group.psnr.mean())
        grade = read_json(folder / str(pattern) / "pattern.json").get("grade", "")
        numbers = (round(clean, 3), round(rainy, 3), round(clean - rainy, 3))
        rows.append((pattern, grade, track, profile, len(group), *numbers))
    return pd.DataFrame(rows, columns=COLUMNS)
