"""How much plain 3D Gaussian splatting loses to a scene's rain, taken from a results folder into its data card."""

from dataclasses import fields, replace
from pathlib import Path
from statistics import mean, median

import pandas as pd

from hydroviews.dataset.card.card import CARD, LOSSES, write_card
from hydroviews.dataset.manifest import data_hash, read_manifest, record_files
from hydroviews.dataset.variants import is_captured
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json
from hydroviews.formats.capture_json import CAPTURED
from hydroviews.formats.read import read_scene
from hydroviews.formats.tables.csv_tables import read_csv, write_csv
from hydroviews.rain.lens.patterns.pattern import RaindropPattern
from hydroviews.rain.patterns import PATTERN_FILE
from hydroviews.rain.scene_statistics import SceneStatistics, survey
from leaderboard.records import CEILING, FLOOR, GIVEN_POSES, LEADERBOARD, SCORED

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
    write_csv(folder / LOSSES, losses)
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
        table = read_csv(path, texts=TEXT)
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
        grade = read_json(folder / str(pattern) / PATTERN_FILE).get("grade", "")
        numbers = (round(clean, 3), round(rainy, 3), round(clean - rainy, 3))
        rows.append((pattern, grade, track, profile, len(group), *numbers))
    return pd.DataFrame(rows, columns=COLUMNS)


def numbers_for_grades(folder: Path, losses: pd.DataFrame) -> dict[str, float]:
    """What a capture's `capture.json` may say so that its grades are met.

    Args:
        folder: of the finished scene.
        losses: of its variants, a table of `losses_of`; those of other tracks than GIVEN_POSES and of real rain do not
            count.

    Returns:
        `clean_error` and, where `raindrop` patterns are among the losses, `drops_cost`, the median over them; two
        decimals. Empty where no loss counts. See `formats.capture_json`.
    """
    losses = losses[(losses.track == GIVEN_POSES) & (losses.pattern != CAPTURED)]
    if losses.empty:
        return {}
    statistics = survey(read_scene(folder), seed=0)
    errors = [(row["pattern"], mse(row["clean"]), mse(row["rainy"])) for row in losses.to_dict("records")]
    numbers = {"clean_error": mean(clean for _, clean, _ in errors) / statistics.detail}
    costs = [
        _drops_cost(pattern, rainy - clean, statistics)
        for name, clean, rainy in errors
        if (pattern := _drops_on_the_lens(folder / name)) is not None
    ]
    if costs and median(costs) > 0:
        numbers["drops_cost"] = median(costs)
    return {name: round(number, 2) for name, number in numbers.items()}


def mse(psnr: float) -> float:
    """Mean squared error of pictures in [0, 1] by their PSNR in dB."""
    return float(10 ** (-psnr / 10))


def _drops_cost(pattern: RaindropPattern, harm: float, statistics: SceneStatistics) -> float:
    """What sharp drops cost over what is predicted: the error that a pattern added, less what its mist is to do."""
    from hydroviews.rain.lens.severity import drops_harm, veil_harm  # SciPy, which not every command needs

    by_drops = harm - veil_harm(pattern, statistics)(pattern.mist)
    return by_drops / drops_harm(pattern.coverage, replace(statistics, drops_cost=1.0))


def _drops_on_the_lens(variant: Path) -> RaindropPattern | None:
    """The pattern of a variant of the effect `raindrop`; None for others."""
    facts = read_json(variant / PATTERN_FILE)
    if facts["effect"] != "raindrop":
        return None
    parameters = facts["parameters"]
    return RaindropPattern(**{field.name: parameters[field.name] for field in fields(RaindropPattern)})
