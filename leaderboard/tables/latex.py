"""Tables as LaTeX: scenes in the paper's layout, scenes down, methods across; needs booktabs and graphicx.

The best of a row is bold, the second italic; of a method that lacks runs underlined, with how many it has.
"""

from collections.abc import Hashable, Iterator, Mapping, Sequence
from typing import Any

import pandas as pd

from hydroviews.dataset.suites import suite_of
from hydroviews.metrics import Metric, find_metrics
from leaderboard.tables.dataframes import SuiteTables, Tables
from leaderboard.tables.markdown import COST_TITLES, PAPER, SHARED, cost_text, paper_scores, suite_title
from leaderboard.tables.means import incomplete, places
from leaderboard.tables.paper_numbers import NOTE, published_ablation, published_scores

SPECIAL = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    **{char: f"\\{char}" for char in "&%$#_{}"},
}
SHOWN = 3  # metrics, as in the paper: PSNR, SSIM, LPIPS
PUBLISHED = "(paper)"  # marks rows that are not of our runs
MEANS = (
    "Means over the runs that all methods have; best bold, second italic; underlined where a method lacks runs, with "
    "finished/planned."
)


def latex_text(text: str) -> str:
    """Text with LaTeX's special characters escaped."""
    return "".join(SPECIAL.get(char, char) for char in text)


def to_latex(tables: Tables) -> str:
    """By profile, track and suite: its scenes in one table, then severity grades, costs and the ablation.

    Then the same of the second blocks that there are: see `means.blocks`.
    """
    parts = (tables.scenes, tables.suites, ""), (tables.shared_scenes, tables.shared_suites, f" {SHARED}.")
    texts = []
    for keys in tables.suites:
        where = f"{suite_title(*keys)}."
        for scenes, suites, remark in parts:
            own = {scene: table for (scene, *place), table in scenes.items() if (*place, suite_of(scene)) == keys}
            if own:
                texts.append(_scenes_table(own, where + remark))
            if keys in suites:
                texts += _suite_tables(suites[keys], where + remark)
    return "\n\n".join(texts) + "\n"


def _scenes_table(blocks: Mapping[str, pd.DataFrame], where: str) -> str:
    methods = list(dict.fromkeys(str(method) for block in blocks.values() for method in block.index))
    effects = sorted({str(effect) for block in blocks.values() for effect in block.columns.get_level_values(0)})
    metrics = find_metrics()[:SHOWN]
    n = len(metrics)
    heads = "".join(f" & \\multicolumn{{{n}}}{{c}}{{{latex_text(method)}}}" for method in methods)
    rules = " ".join(f"\\cmidrule(lr){{{3 + n * i}-{2 + n * (i + 1)}}}" for i in range(len(methods)))
    titles = ["Effect", "Scene", *(latex_text(metric.title) for _ in methods for metric in metrics)]
    lines = []
    for effect in effects:
        lines.append(r"\midrule")
        for scene, block in blocks.items():
            if effect in block.columns.get_level_values(0):
                cells = _cells(pd.DataFrame(block[effect]), methods)
                lines.append(_line([latex_text(effect), latex_text(scene), *cells]))
                lines += _paper_lines(scene, effect, methods)
    note = f" {NOTE}" if any(PUBLISHED in line for line in lines) else ""
    head = [rf" & {heads} \\", rules, _line(titles)]
    return _floating(f"{where} {MEANS}{note}", f"ll*{{{n * len(methods)}}}{{c}}", [*head, *lines])


def _paper_lines(scene: str, effect: str, methods: Sequence[str]) -> list[str]:
    """What the paper published of our methods on a scene, as a row below ours; no row where it has nothing."""
    known = published_scores(scene, effect)
    paper = known[known.index.isin(methods)].to_dict("index")
    cells = [cell for method in methods for cell in _paper_cells(paper.get(method))]
    return [_line([latex_text(effect), f"{latex_text(scene)} {PUBLISHED}", *cells])] if paper else []


def _paper_cells(row: Mapping[Any, Any] | None) -> list[str]:
    if row is None:
        return ["--"] * SHOWN
    texts = [*paper_scores(row), f"{row['lpips']:.3f}"]
    return [rf"\underline{{{text}}}" if row["failed"] else text for text in texts]


def _suite_tables(found: SuiteTables, where: str) -> Iterator[str]:
    """Severity grades, costs and the ablation of a suite, a row a method; those that there are."""
    shown, paper = find_metrics()[:SHOWN], published_ablation().to_dict("index")
    titles = [metric.title for metric in shown]
    grades = [
        [latex_text(str(effect)), str(grade), *cells]
        for (effect, grade), block in found.grades.groupby(["effect", "grade"], sort=False)
        for cells in _method_rows(block, shown)
    ]
    costs = [
        [*cells, *(cost_text(row[name]) or "--" for name in COST_TITLES), latex_text(row["device"])]
        for cells, row in zip(_method_rows(found.costs, shown[:1]), found.costs.to_dict("records"), strict=True)
    ]
    ablation = [
        [paper[method]["paper_method"], *cells, *paper_scores(paper[method])]
        for method, cells in zip(found.ablation.index, _method_rows(found.ablation, shown[:2]), strict=True)
    ]
    for rows, caption, head in (
        (grades, "Severity grades.", ["Effect", "Grade", "Method", *titles]),
        (costs, "Costs of a run.", ["Method", titles[0], *COST_TITLES.values(), "device"]),
        (ablation, f"The paper's ablation. {NOTE}", ["Ablation", "Method", *titles[:2], *PAPER[:2]]),
    ):
        if rows:
            lines = [_line([latex_text(title) for title in head]), r"\midrule", *map(_line, rows)]
            yield _floating(f"{where} {caption} {MEANS}", "l" * len(head), lines)


def _method_rows(means: pd.DataFrame, metrics: Sequence[Metric]) -> Iterator[list[str]]:
    """A method's name and its scores, by row."""
    order = {metric.name: places(means, metric) for metric in metrics}
    for method, row in means.to_dict("index").items():
        yield [
            latex_text(str(method)),
            *(_cell(row, metric, order[metric.name].get(str(method))) for metric in metrics),
        ]


def _line(cells: Sequence[str]) -> str:
    return " & ".join(cells) + r" \\"


def _floating(caption: str, columns: str, lines: Sequence[str]) -> str:
    return "\n".join(
        [
            r"\begin{table*}",
            rf"\caption{{{latex_text(caption.replace('`', ''))}}}",
            r"\resizebox{\textwidth}{!}{%",
            rf"\begin{{tabular}}{{{columns}}}",
            r"\toprule",
            *lines,
            r"\bottomrule",
            r"\end{tabular}}",
            r"\end{table*}",
        ]
    )


def _cells(block: pd.DataFrame, methods: list[str]) -> list[str]:
    known = block.dropna(subset=["finished"])
    scores = dict(
        zip(map(str, known.index), (cells[1:] for cells in _method_rows(known, find_metrics()[:SHOWN])), strict=True)
    )
    return [cell for method in methods for cell in scores.get(method, ["--"] * SHOWN)]


def _cell(row: Mapping[Hashable, Any], metric: Metric, place: int | None) -> str:
    value = "--" if pd.isna(row[metric.name]) else metric.text(row[metric.name])
    shown = {1: rf"\textbf{{{value}}}", 2: rf"\textit{{{value}}}"}.get(place or 0, value)
    counts = f"$^{{{int(row['finished'])}/{int(row['planned'])}}}$"
    return rf"\underline{{{shown}}}{counts}" if incomplete(row) else shown
