"""Tables as LaTeX in the paper's layout: scenes down, methods across; needs booktabs and graphicx.

The best of a row is bold, the second italic; of a method that lacks runs underlined, with how many it has.
"""

from collections.abc import Hashable, Mapping
from typing import Any

import pandas as pd

from hydroviews.dataset.suites import suite_of
from hydroviews.metrics import Metric, find_metrics
from leaderboard.tables.dataframes import Tables
from leaderboard.tables.means import incomplete, places

SPECIAL = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    **{char: f"\\{char}" for char in "&%$#_{}"},
}
SHOWN = 3  # metrics, as in the paper: PSNR, SSIM, LPIPS


def latex_text(text: str) -> str:
    """Text with LaTeX's special characters escaped."""
    return "".join(SPECIAL.get(char, char) for char in text)


def to_latex(tables: Tables) -> str:
    """All scenes, a table a profile, track and suite."""
    texts = []
    for profile, track, suite in tables.suites:
        blocks = {
            scene: found
            for (scene, *place), found in tables.scenes.items()
            if [*place, suite_of(scene)] == [profile, track, suite]
        }
        texts.append(_table(blocks, f"{f'Suite {suite}' if suite else 'Other scenes'}, {profile}, {track}."))
    return "\n\n".join(texts) + "\n"


def _table(blocks: Mapping[str, pd.DataFrame], caption: str) -> str:
    methods = list(dict.fromkeys(str(method) for block in blocks.values() for method in block.index))
    effects = sorted({str(effect) for block in blocks.values() for effect in block.columns.get_level_values(0)})
    metrics = find_metrics()[:SHOWN]
    n = len(metrics)
    heads = "".join(f" & \\multicolumn{{{n}}}{{c}}{{{latex_text(method)}}}" for method in methods)
    rules = " ".join(f"\\cmidrule(lr){{{3 + n * i}-{2 + n * (i + 1)}}}" for i in range(len(methods)))
    titles = " & ".join(["Effect", "Scene", *(latex_text(metric.title) for _ in methods for metric in metrics)])
    lines = []
    for effect in effects:
        lines.append(r"\midrule")
        for scene, block in blocks.items():
            if effect in block.columns.get_level_values(0):
                cells = _cells(pd.DataFrame(block[effect]), methods)
                lines.append(" & ".join([latex_text(effect), latex_text(scene), *cells]) + r" \\")
    return "\n".join(
        [
            r"\begin{table*}",
            rf"\caption{{{latex_text(caption)} Means over the runs that all methods have; best bold, second italic; "
            "underlined where a method lacks runs, with finished/planned.}",
            r"\resizebox{\textwidth}{!}{%",
            rf"\begin{{tabular}}{{ll*{{{n * len(methods)}}}{{c}}}}",
            r"\toprule",
            rf" & {heads} \\",
            rules,
            rf"{titles} \\",
            *lines,
            r"\bottomrule",
            r"\end{tabular}}",
            r"\end{table*}",
        ]
    )


def _cells(block: pd.DataFrame, methods: list[str]) -> list[str]:
    known = block.dropna(subset=["finished"])
    rows = known.to_dict("index")
    order = {metric.name: places(known, metric) for metric in find_metrics()[:SHOWN]}
    return [
        _cell(rows[method], metric, order[metric.name].get(method)) if method in rows else "--"
        for method in methods
        for metric in find_metrics()[:SHOWN]
    ]


def _cell(row: Mapping[Hashable, Any], metric: Metric, place: int | None) -> str:
    value = "--" if pd.isna(row[metric.name]) else metric.text(row[metric.name])
    shown = {1: rf"\textbf{{{value}}}", 2: rf"\textit{{{value}}}"}.get(place or 0, value)
    counts = f"$^{{{int(row['finished'])}/{int(row['planned'])}}}$"
    return rf"\underline{{{shown}}}{counts}" if incomplete(row) else shown
