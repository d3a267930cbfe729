"""Records as tables people read: one a scene, methods down, effects across."""

from pathlib import Path

import pandas as pd

from hydroviews.dataset.clean_views import CLEAN
from hydroviews.files.atomic import write_bytes
from leaderboard.severity import CEILING, FLOOR

TABLES = "tables.md"
METRICS = {"psnr": "PSNR", "ssim": "SSIM", "lpips_alex": "LPIPS", "lpips_vgg": "LPIPS-VGG"}
DECIMALS = {"psnr": 2, "ssim": 4, "lpips_alex": 4, "lpips_vgg": 4}


def scene_table(table: pd.DataFrame, scene: str, profile: str, track: str) -> pd.DataFrame:
    """One scene's means in one track, over patterns and seeds: a row a method, columns (effect, metric).

    The ceiling, trained once on clean views, stands under every effect. `gap` is the share of the way from
    floor to ceiling in PSNR (see `share_of_gap`); `runs` counts done/all.
    """
    rows = table[(table.scene == scene) & (table.profile == profile) & (table.track == track)]
    effects = sorted(set(rows.effect) - {CLEAN}) or [CLEAN]
    blocks = {effect: _effect_block(rows[rows.effect.isin([effect, CLEAN])]) for effect in effects}
    joined = pd.concat(blocks, axis=1)
    order = sorted(joined.index, key=lambda m: (m != CEILING, m != FLOOR, m))
    return joined.loc[order]


def _effect_block(rows: pd.DataFrame) -> pd.DataFrame:
    done = rows[rows.status == "done"]
    numbers = done.astype(dict.fromkeys(METRICS, float)).groupby("method")[list(METRICS)].mean()
    block = numbers.reindex(sorted(set(rows.method)))
    block["gap"] = [share_of_gap(done, method) for method in block.index]
    block["train_s"] = done.groupby("method")["train_s"].mean().astype(float)
    counts = rows.groupby("method")["status"].agg(lambda s: f"{(s == 'done').sum()}/{len(s)}")
    block["runs"] = counts
    return block


def share_of_gap(done: pd.DataFrame, method: str) -> float:
    """(PSNR - floor) / (ceiling - floor), means over the runs that have both references.

    A run's floor has its pattern, seed and data, its ceiling its seed. NaN where no run has both, or the
    ceiling is not above the floor.
    """
    same = ["pattern", "seed", "data_sha256"]
    floor = done[done.method == FLOOR][[*same, "psnr"]]
    ceiling = done[done.method == CEILING][["seed", "psnr"]]
    runs = done[done.method == method][[*same, "psnr"]]
    if method == CEILING:  # it stands for itself wherever there is a floor
        runs = floor[same].merge(ceiling, on="seed")
    runs = runs.merge(floor, on=same, suffixes=("", "_floor")).merge(ceiling, on="seed", suffixes=("", "_ceiling"))
    means = runs[["psnr", "psnr_floor", "psnr_ceiling"]].astype(float).mean()
    gap = means["psnr_ceiling"] - means["psnr_floor"]
    return float((means["psnr"] - means["psnr_floor"]) / gap) if gap > 0 else float("nan")


def to_markdown(table: pd.DataFrame) -> str:
    """A scene's table as Markdown, the effects one below the other."""
    parts = []
    for effect in dict.fromkeys(table.columns.get_level_values(0)):
        heads = ["method", *METRICS.values(), "share of gap", "train s", "runs"]
        lines = [f"| {effect} | " + " | ".join(heads[1:]) + " |", "|---" * len(heads) + "|"]
        for method, row in table[effect].iterrows():
            cells = [_number(row[name], DECIMALS[name]) for name in METRICS]
            cells += [_percent(row["gap"]), _number(row["train_s"], 0), "" if pd.isna(row["runs"]) else row["runs"]]
            lines.append(f"| {method} | " + " | ".join(cells) + " |")
        parts.append("\n".join(lines))
    return "\n\n".join(parts) + "\n"


def _number(value: float, decimals: int) -> str:
    return "" if pd.isna(value) else f"{value:.{decimals}f}"


def _percent(value: float) -> str:
    return "" if pd.isna(value) else f"{100 * value:.0f} %"


def print_scene(table: pd.DataFrame, scene: str, profile: str, track: str) -> None:
    """Print one scene's table."""
    print(f"\n{scene} ({profile}, {track})\n\n{to_markdown(scene_table(table, scene, profile, track))}", end="")


def scene_keys(table: pd.DataFrame) -> list[tuple[str, str, str]]:
    """Scene, profile and track of every table there is, sorted by profile, scene and track."""
    keys = sorted({(str(row.profile), str(row.scene), str(row.track)) for row in table.itertuples()})
    return [(scene, profile, track) for profile, scene, track in keys]


def write_tables(table: pd.DataFrame, results: Path) -> None:
    """Write `tables.md`: every scene of every profile, a table a track."""
    parts = [
        f"## {scene} ({profile}, {track})\n\n{to_markdown(scene_table(table, scene, profile, track))}"
        for scene, profile, track in scene_keys(table)
    ]
    write_bytes(results / TABLES, "\n".join(parts).encode())
