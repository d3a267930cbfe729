"""Every table that is written, against an independent calculation by pandas from the records; and its LaTeX."""

import re

import numpy as np
import pandas as pd
import pytest

from hydroviews.metrics import find_metrics
from leaderboard.means import COSTS
from leaderboard.published import ABLATION, published, published_ablation, published_scores
from leaderboard.records import columns
from leaderboard.table_files import write_tables
from leaderboard.table_latex import latex_text

METHODS = ("3dgs", "ours_&_%", "deraings", "fewer")
SCENES = ("room", "pond", "mipnerf360_bonsai")
PATTERNS = ("raindrop-0", "raindrop-1", "raindrop-2", "streak-1")
METRICS = [metric.name for metric in find_metrics()]


def board() -> pd.DataFrame:
    """Runs of random numbers; `fewer` lacks some, and another room was built anew for one run."""
    rng = np.random.default_rng(0)
    runs = []
    for method in (*METHODS, "3dgs-clean"):
        for scene in SCENES:
            for pattern in ["clean"] if method == "3dgs-clean" else PATTERNS:
                for seed in (0, 1) if scene == "room" else (0,):
                    keys = {"method": method, "scene": scene, "pattern": pattern, "seed": seed, "profile": "demo"}
                    keys |= {"effect": pattern.partition("-")[0], "track": "given-poses", "submitted_by": ""}
                    numbers = {name: rng.uniform(0, 30) for name in (*METRICS, *COSTS)}
                    keys |= {"data_sha256": scene + pattern, "status": "done", "device": "cpu"}
                    runs.append(dict.fromkeys(columns()) | keys | numbers)
    table = pd.DataFrame(runs)
    lost = (table.method == "fewer") & (table.pattern == "raindrop-1") & (table.scene == "room") & (table.seed == 0)
    table.loc[lost, ["status", *METRICS, *COSTS]] = ["failed", *[None] * (len(METRICS) + len(COSTS))]
    table.loc[table.method == "3dgs-clean", "psnr"] += 40
    old = (table.method == "fewer") & (table.pattern == "streak-1") & (table.scene == "pond")
    table.loc[old, "data_sha256"] = "of an older build"
    return table


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tables")
    write_tables(board(), folder)
    return folder


def by_pandas(rows: pd.DataFrame, name: str) -> dict[str, float]:
    """Means over the complete rows of a table with a column a method, then over seeds, patterns and scenes."""
    wide = rows[rows.pattern != "clean"].pivot(
        index=["scene", "pattern", "seed", "data_sha256"], columns="method", values=name
    )
    wide = wide.astype(float).loc[:, lambda found: found.notna().any()]
    full = wide.dropna()
    if full.empty:  # the one method that shares nothing stays out
        wide = wide.drop(columns="fewer")
        full = wide.dropna()
    found = dict(full.groupby(["scene", "pattern"]).mean().groupby("scene").mean().mean())
    clean = rows[rows.pattern == "clean"].astype({name: float})
    return found | dict(clean.groupby(["method", "scene"])[name].mean().groupby("method").mean())


def agree(found: pd.DataFrame, rows: pd.DataFrame, names) -> None:
    for name in names:
        expected = by_pandas(rows, name)
        given = dict(zip(found.method, found[name], strict=True))
        assert {method: value for method, value in given.items() if not np.isnan(value)} == pytest.approx(expected)


def test_scene_tables_agree_with_pandas(written):
    found, table = pd.read_csv(written / "tables.csv"), board()
    assert len(found) == 3 * 2 * 5
    for (scene, effect), block in found.groupby(["scene", "effect"]):
        agree(block, table[(table.scene == scene) & table.effect.isin([effect, "clean"])], [*METRICS, *COSTS])
    one = found[(found.scene == "room") & (found.effect == "raindrop")].set_index("method")
    assert dict(one.finished) == {"3dgs-clean": 2, "3dgs": 6, "deraings": 6, "fewer": 5, "ours_&_%": 6}
    assert set(one.compared[one.reference == False]) == {5}  # noqa: E712 - a column
    kept = table[(table.scene == "room") & (table.effect == "raindrop")].pivot(
        index=["pattern", "seed"], columns="method", values="psnr"
    )
    kept = kept.astype(float).dropna()
    ceiling = table[(table.scene == "room") & (table.method == "3dgs-clean")].set_index("seed").psnr.astype(float)
    kept["top"] = kept.index.get_level_values("seed").map(ceiling)
    means = kept.groupby("pattern").mean().mean()
    gap = (means["deraings"] - means["3dgs"]) / (means["top"] - means["3dgs"])
    assert one.gap["deraings"] == pytest.approx(gap)


def test_grades_and_costs_agree_with_pandas(written):
    table = board()
    grades, costs = (pd.read_csv(written / f"{name}.csv") for name in ("grades", "costs"))
    for (suite, effect, grade), block in grades.fillna({"suite": ""}).groupby(["suite", "effect", "grade"]):
        scenes = ["mipnerf360_bonsai"] if suite == "development" else ["room", "pond"]
        number = {"light": 0, "medium": 1, "heavy": 2}[grade]
        agree(block, table[table.scene.isin(scenes) & (table.pattern == f"{effect}-{number}")], METRICS)
    assert list(grades.groupby(["suite", "effect", "grade"]).size()) == [4] * 8
    for suite, block in costs.groupby("suite"):
        scenes = ["mipnerf360_bonsai"] if suite == "development" else ["room", "pond"]
        agree(block, table[table.scene.isin(scenes)], [*COSTS, "psnr"])


def test_the_ablation_agrees_with_pandas(written):
    text = (written / "tables.md").read_text()
    table = board()
    rows = table[table.scene.isin(["room", "pond"]) & table.method.isin(["3dgs", "deraings"])]
    expected = by_pandas(rows, "psnr")
    best = max(expected, key=expected.get)
    full = "(f) 3DGS; image enhancement; mask module; channel attention"
    for label, method in (("(b) 3DGS", "3dgs"), (full, "deraings")):
        shown = f"**{expected[method]:.2f}**" if method == best else f"{expected[method]:.2f}"
        assert f"| {label} | {method} | {shown} |" in text


def test_the_markdown_shows_the_numbers_of_the_csv(written):
    text = (written / "tables.md").read_text()
    found = pd.read_csv(written / "tables.csv").set_index(["scene", "effect", "method"])
    assert f"| 3dgs-clean | {found.psnr['room', 'raindrop', '3dgs-clean']:.2f} |" in text
    assert re.search(r"\| fewer \| <u>\d+\.\d\d</u> .*<u>5/6</u> \|", text)
    assert "underlined: of a method that lacks runs" in text


def test_published_numbers_stand_in_columns_of_their_own_with_the_reason(written):
    text = (written / "tables.md").read_text()
    assert "| runs | PSNR (paper) | SSIM (paper) | LPIPS (paper) |" in text
    assert text.count("27.41 | 0.877 | 0.173 |") == 1  # DeRainGS on bonsai with drops, table 1
    assert "are not of our runs and differ" in text
    assert "27.41" not in (written / "tables.csv").read_text()


def test_the_published_tables_are_whole():
    found = published()
    assert dict(found.table.value_counts()) == {1: 70, 2: 20, 3: 5}
    assert found[["psnr", "ssim"]].notna().all(axis=None)
    assert published_scores("mipnerf360_kitchen", "streak").failed.to_dict()["gs-w"]
    assert int(found.failed.sum()) == 3
    assert published_scores("", "captured").empty  # Doraemon, of which it is not known which of ours it is
    assert tuple(published_ablation().index) == ABLATION
    means = found[(found.table == 1) & (found.effect == "raindrop")].groupby("method").psnr.mean()
    assert means["deraings"] == pytest.approx(26.79, abs=0.005)  # of the column as printed


def test_the_latex_has_a_cell_for_every_column_and_marks_best_second_and_missing(written):
    text = (written / "tables.tex").read_text()
    assert text.count(r"\begin{table*}") == text.count(r"\end{table*}") == 2
    rows = [line for line in text.splitlines() if line.startswith(("raindrop &", "streak &"))]
    assert len(rows) == 6
    assert {len(re.split(r"(?<!\\)&", row)) for row in rows} == {2 + 5 * 3}
    for row in rows:
        assert row.count(r"\textbf{") == row.count(r"\textit{") == 3  # a metric
    assert len(re.findall(r"\\underline\{[^$]*\}\$\^\{5/6\}\$", text)) == 3
    assert r"ours\_\&\_\%" in text
    assert text.count("{") == text.count("}")


def test_names_cannot_break_the_latex():
    assert latex_text("a_b\\input{x}$#^~") == (r"a\_b\textbackslash{}input\{x\}\$\#\textasciicircum{}\textasciitilde{}")
