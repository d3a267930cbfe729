"""Every table that is written, against an independent calculation by pandas from the records; and its LaTeX."""

import itertools
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made_up_board import run_row

from hydroviews.metrics import find_metrics
from leaderboard.tables.latex import latex_text
from leaderboard.tables.means import COSTS
from leaderboard.tables.paper_numbers import ABLATION, published, published_ablation, published_scores
from leaderboard.tables.table_files import write_tables

METHODS = ("3dgs", "ours_&_%", "deraings", "fewer")
SUITES = {"test": ("room", "pond"), "development": ("mipnerf360_bonsai",)}
SCENES = (*SUITES["test"], *SUITES["development"])
PATTERNS = ("raindrop-0", "raindrop-1", "raindrop-2", "streak-1")
METRICS = [metric.name for metric in find_metrics()]


def board() -> pd.DataFrame:
    """Runs of random numbers; `fewer` lacks some, and another room was built anew for one run."""
    rng = np.random.default_rng(0)
    runs = []
    for method, scene, seed in itertools.product((*METHODS, "3dgs-clean"), SCENES, (0, 1)):
        for pattern in ["clean"] if method == "3dgs-clean" else PATTERNS:
            if scene == "room" or not seed:
                numbers = {name: rng.uniform(0, 30) for name in (*METRICS, *COSTS)}
                runs.append(run_row(method, scene, pattern, seed, device="cpu", **numbers))
    table = pd.DataFrame(runs)
    fewer = table.method == "fewer"
    lost = fewer & (table.pattern == "raindrop-1") & (table.scene == "room") & (table.seed == 0)
    table.loc[lost, ["status", *METRICS, *COSTS]] = ["failed", *[None] * (len(METRICS) + len(COSTS))]
    table.loc[table.method == "3dgs-clean", "psnr"] += 40
    table.loc[fewer & (table.pattern == "streak-1") & (table.scene == "pond"), "data_sha256"] = "of an older build"
    return table


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tables")
    write_tables(board(), folder)
    return folder


def by_pandas(rows: pd.DataFrame, name: str) -> dict[str, float]:
    """Means over the complete rows of a table with a column a method, then over seeds, patterns and scenes."""
    keys = ["scene", "pattern", "seed", "data_sha256"]
    wide = rows[rows.pattern != "clean"].pivot(index=keys, columns="method", values=name)
    wide = wide.astype(float).dropna(axis=1, how="all")
    full = wide.dropna()
    if full.empty:  # the one method that shares nothing stays out
        wide = wide.drop(columns="fewer")
        full = wide.dropna()
    found = dict(full.groupby(["scene", "pattern"]).mean().groupby("scene").mean().mean())
    clean = rows[rows.pattern == "clean"].astype({name: float})
    return found | dict(clean.groupby(["method", "scene"])[name].mean().groupby("method").mean())


def agree(found: pd.DataFrame, rows: pd.DataFrame, names) -> None:
    for name in names:
        given = found.set_index("method")[name].dropna()
        assert dict(given) == pytest.approx(by_pandas(rows, name))


def test_scene_tables_agree_with_pandas(written):
    found, table = pd.read_csv(written / "tables.csv"), board()
    assert len(found) == 3 * 2 * 5
    for (scene, effect), block in found.groupby(["scene", "effect"]):
        agree(block, table[(table.scene == scene) & table.effect.isin([effect, "clean"])], [*METRICS, *COSTS])
    one = found[(found.scene == "room") & (found.effect == "raindrop")].set_index("method")
    assert dict(one.finished) == {"3dgs-clean": 2, "3dgs": 6, "deraings": 6, "fewer": 5, "ours_&_%": 6}
    assert set(one.compared[one.reference == False]) == {5}  # noqa: E712 - a column
    kept = table[(table.scene == "room") & (table.effect == "raindrop")]
    kept = kept.pivot(index=["pattern", "seed"], columns="method", values="psnr").astype(float).dropna()
    ceiling = table[(table.scene == "room") & (table.method == "3dgs-clean")].set_index("seed").psnr.astype(float)
    kept["top"] = kept.index.get_level_values("seed").map(ceiling)
    means = kept.groupby("pattern").mean().mean()  # a scene weighs its patterns alike, a pattern its seeds
    gap = (means["deraings"] - means["3dgs"]) / (means["top"] - means["3dgs"])
    assert one.gap["deraings"] == pytest.approx(gap)


def test_grades_and_costs_agree_with_pandas(written):
    table = board()
    grades, costs = (pd.read_csv(written / f"{name}.csv") for name in ("grades", "costs"))
    for (suite, effect, grade), block in grades.groupby(["suite", "effect", "grade"]):
        number = {"light": 0, "medium": 1, "heavy": 2}[grade]
        agree(block, table[table.scene.isin(SUITES[suite]) & (table.pattern == f"{effect}-{number}")], METRICS)
    assert list(grades.groupby(["suite", "effect", "grade"]).size()) == [4] * 8
    for suite, block in costs.groupby("suite"):
        agree(block, table[table.scene.isin(SUITES[suite])], [*COSTS, "psnr"])


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


def shown(row: pd.Series, names, empty: str = "") -> list[str]:
    """Numbers of a row of a CSV as tables print them: PSNR with two decimals, other scores four, costs one."""
    digits = dict.fromkeys(METRICS, 4) | {"psnr": 2} | dict.fromkeys(COSTS, 1)
    return [empty if np.isnan(row[name]) else f"{row[name]:.{digits[name]}f}" for name in names]


def by_suite(folder: Path, name: str) -> dict[str, pd.DataFrame]:
    return dict(iter(pd.read_csv(folder / f"{name}.csv").groupby("suite")))


def runs_of(row: pd.Series) -> str:
    return f"{row.finished}/{row.planned}"


def latex_tables(folder: Path) -> dict[tuple[str, str], list[list[str]]]:
    """Cells without marks, by suite and first title; the methods of a table of scenes are its first row."""
    found = {}
    for text in (folder / "tables.tex").read_text().split(r"\begin{table*}")[1:]:
        plain = re.sub(r"\$\^\{\d+/\d+\}\$|\\(?:textbf|textit|underline)\{([^}]*)\}", r"\1", text)
        rows = [line.removesuffix(r" \\").split(" & ") for line in plain.splitlines() if line.endswith(r" \\")]
        suite = re.search(r"\\caption\{Suite (\w+), demo, given-poses\.", text)[1]
        if r"\multicolumn" in text:
            rows[0] = re.findall(r"\\multicolumn\{3\}\{c\}\{([^}]*)\}", text)
            found[suite, "Scenes"] = [rows[0], *rows[2:]]
        else:
            found[suite, rows[0][0]] = rows[1:]
    return found


def markdown_tables(folder: Path) -> dict[tuple[str, str], list[list[str]]]:
    """Cells without marks, by the title above and the first cell."""
    found = {}
    for section in (folder / "tables.md").read_text().split("## ")[1:]:
        title, _, text = section.partition(" (demo, given-poses")
        for table in re.findall(r"(?:^\|.*\n?)+", text, re.MULTILINE):
            head, _, *rows = [line[2:-2].split(" | ") for line in re.sub(r"\*\*|</?u>", "", table).splitlines()]
            found[title.removeprefix("suite "), head[0]] = [[cell.strip() for cell in row] for row in rows]
    return found


def test_every_cell_of_the_scenes_in_latex_is_a_number_of_the_csv(written):
    found = pd.read_csv(written / "tables.csv")
    numbers = {(row.effect, latex_text(row.scene), latex_text(row.method)): row for _, row in found.iterrows()}
    for suite, scenes in SUITES.items():
        methods, *rows = latex_tables(written)[suite, "Scenes"]
        assert methods == [latex_text(name) for name in ("3dgs-clean", "3dgs", "deraings", "fewer", "ours_&_%")]
        ours = [row for row in rows if "(paper)" not in row[1]]
        assert len({(effect, scene) for effect, scene, *_ in ours}) == len(ours) == 2 * len(scenes)
        for effect, scene, *cells in ours:
            rows_of = [numbers[effect, scene, method] for method in methods]
            assert cells == [text for row in rows_of for text in shown(row, METRICS[:3], "--")]


def test_every_cell_of_grades_costs_and_ablation_in_latex_is_a_number_of_the_csv(written):
    tables = latex_tables(written)
    for suite in SUITES:
        grades, costs, ablation = (by_suite(written, name)[suite] for name in ("grades", "costs", "ablation"))
        assert tables[suite, "Effect"] == [
            [row.effect, row.grade, latex_text(row.method), *shown(row, METRICS[:3], "--")]
            for _, row in grades.iterrows()
        ]
        assert tables[suite, "Method"] == [
            [latex_text(row.method), *shown(row, ["psnr", *COSTS], "--"), row.device] for _, row in costs.iterrows()
        ]
        assert tables[suite, "Ablation"] == [
            [row.paper_method, row.method, *shown(row, METRICS[:2]), f"{row.paper_psnr:.2f}", f"{row.paper_ssim:.3f}"]
            for _, row in ablation.iterrows()
        ]


def test_every_cell_of_the_markdown_is_a_number_of_the_csv(written):
    tables = markdown_tables(written)
    for keys, block in pd.read_csv(written / "tables.csv").groupby(["scene", "effect"]):
        for cells, (_, row) in zip(tables.pop(keys), block.iterrows(), strict=True):
            gap = "" if np.isnan(row.gap) else f"{100 * row.gap:.0f} %"
            seconds = "" if np.isnan(row.train_s) else f"{row.train_s:.0f}"
            assert cells[:8] == [row.method, *shown(row, METRICS), gap, seconds, runs_of(row)]
    for keys, block in pd.read_csv(written / "grades.csv").groupby(["suite", "effect"]):
        for method, *cells in tables.pop(keys):
            own = block[block.method == method]
            assert cells == [f"{shown(row, ['psnr'])[0]} ({runs_of(row)})" for _, row in own.iterrows()]
    for suite, block in by_suite(written, "costs").items():
        assert tables.pop((suite, "costs")) == [
            [row.method, *shown(row, ["psnr", *COSTS]), row.device, runs_of(row)] for _, row in block.iterrows()
        ]
    for suite, block in by_suite(written, "ablation").items():
        assert [cells[:5] for cells in tables.pop((suite, "ablation"))] == [
            [row.paper_method, row.method, *shown(row, METRICS[:2]), runs_of(row)] for _, row in block.iterrows()
        ]
    assert not tables


def test_published_numbers_stand_beside_ours_in_latex_and_csv(written):
    methods, *rows = latex_tables(written)["development", "Scenes"]
    [(effect, scene, *cells)] = [row for row in rows if "(paper)" in row[1]]
    assert (effect, scene) == ("raindrop", r"mipnerf360\_bonsai (paper)")
    own = 3 * methods.index("deraings")
    assert cells[own : own + 3] == ["27.41", "0.877", "0.173"]
    assert {*cells[:own], *cells[own + 3 :]} == {"--"}
    assert "They are not our runs" in (written / "tables.tex").read_text()
    columns = ["paper_psnr", "paper_ssim", "paper_lpips"]
    known = pd.read_csv(written / "tables.csv").set_index(["scene", "effect", "method"])[columns].dropna()
    assert list(known.index) == [("mipnerf360_bonsai", "raindrop", "deraings")]
    assert known.to_numpy().tolist() == [[27.41, 0.877, 0.173]]


def test_the_ablation_as_csv_agrees_with_pandas(written):
    table, found = board(), by_suite(written, "ablation")
    for suite, scenes in SUITES.items():
        rows = table[table.scene.isin(scenes) & table.method.isin(["3dgs", "deraings"])]
        assert list(found[suite].method) == ["3dgs", "deraings"]
        agree(found[suite], rows, [*METRICS, *COSTS])
        assert list(found[suite].paper_psnr) == [17.56, 24.67]


def test_the_latex_marks_best_second_and_missing_and_names_are_escaped(written):
    text = (written / "tables.tex").read_text()
    assert text.count(r"\begin{table*}") == text.count(r"\end{table*}") == 2 * 4
    scenes = "".join(part for part in text.split(r"\begin{table*}") if r"\multicolumn" in part)
    rows = [line for line in scenes.splitlines() if line.startswith(("raindrop &", "streak &"))]
    assert {len(re.split(r"(?<!\\)&", row)) for row in rows} == {2 + 5 * 3}
    marks = [[row.count(mark) for mark in (r"\textbf{", r"\textit{")] for row in rows if "(paper)" not in row]
    assert marks == [[3, 3]] * 6  # a metric
    assert len(re.findall(r"\\underline\{[^$]*\}\$\^\{5/6\}\$", scenes)) == 3
    assert len(re.findall(r"\\underline\{[^$]*\}\$\^\{11/12\}\$", text)) == 1  # costs
    assert r"ours\_\&\_\%" in text
    assert text.count("{") == text.count("}")


def test_names_cannot_break_the_latex():
    assert latex_text("a_b\\input{x}$#^~") == (r"a\_b\textbackslash{}input\{x\}\$\#\textasciicircum{}\textasciitilde{}")
