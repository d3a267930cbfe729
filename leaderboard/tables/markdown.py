"""Tables as Markdown: the best of a column bold, what a method that lacks runs has underlined."""

from collections.abc import Hashable, Iterable, Mapping
from typing import Any

import pandas as pd

from hydroviews.dataset.suites import suite_of
from hydroviews.formats.tables.markdown import Markup, markdown_table
from hydroviews.metrics import Metric, find_metrics
from hydroviews.rain.patterns import GRADES
from leaderboard.tables.dataframes import SuiteTables, Tables, scene_tables
from leaderboard.tables.means import Block, incomplete, places
from leaderboard.tables.paper_numbers import NOTE, published_ablation, published_scores

PAPER = ("PSNR (paper)", "SSIM (paper)", "LPIPS (paper)")
SHARED = "All methods, on the runs that all of them have"  # title of a second block
COST_TITLES = {
    "train_s": "train s",
    "before_s": "before s",
    "after_s": "after s",
    "render_fps": "renders/s",
    "peak_mem_mb": "memory MB",
    "peak_gpu_mem_mb": "GPU MB",
    "model_mb": "model MB",
    "n_primitives": "primitives",
}


def to_markdown(table: pd.DataFrame, scene: str = "") -> str:
    """A scene's table as Markdown, the effects one below the other, with what the paper published of it."""
    parts = []
    for effect in dict.fromkeys(table.columns.get_level_values(0)):
        block = table[effect].dropna(subset=["finished"])
        paper = published_scores(scene, str(effect))
        head = (str(effect), *(metric.title for metric in find_metrics()), "share of gap", "train s", "runs")
        beside = {method: _paper_cells(row) for method, row in paper.to_dict("index").items()}
        extra = PAPER if beside else ()
        rows = [(*cells, *beside.get(cells[0], ("",) * len(extra))) for cells in _scene_cells(block)]
        parts.append(markdown_table((*head, *extra), rows, keep_empty=True) + basis(block))
    return "\n\n".join(parts) + "\n"


def _scene_cells(block: pd.DataFrame) -> Iterable[list[str]]:
    scores = {metric.name: score_cells(block, metric) for metric in find_metrics()}
    for method, row in block.to_dict("index").items():
        cells = [scores[metric.name][method] for metric in find_metrics()]
        gap = "" if pd.isna(row["gap"]) else f"{100 * row['gap']:.0f} %"
        yield [str(method), *cells, gap, _number(row["train_s"]), runs_cell(row)]


def score_cells(means: pd.DataFrame, metric: Metric) -> dict[Hashable, str]:
    """A column of scores by method; empty where there is no number."""
    place = places(means, metric)
    return {
        method: _marked("" if pd.isna(row[metric.name]) else metric.text(row[metric.name]), row, place.get(str(method)))
        for method, row in means.to_dict("index").items()
    }


def _marked(text: str, row: Mapping[Any, Any], place: int | None) -> str:
    if not text:
        return ""
    text = Markup(f"**{text}**") if place == 1 else text
    return Markup(f"<u>{text}</u>") if incomplete(row) else text


def runs_cell(row: Mapping[Any, Any]) -> str:
    """Finished of planned runs."""
    text = f"{int(row['finished'])}/{int(row['planned'])}"
    return Markup(f"<u>{text}</u>") if incomplete(row) else text


def basis(block: pd.DataFrame) -> str:
    """A sentence on what a table's means are over, where that is not simply all runs; else empty."""
    ours = block[~block.reference.astype(bool)]
    if len(ours) and ours.shared_runs.iloc[0]:
        return f"\n\n{len(ours)} methods on the runs that all of them have: {ours.shared_runs.iloc[0]}."
    if ours.empty or (ours.compared == ours.planned).all() or (ours.finished == 0).all():
        return ""
    apart = [str(name) for name in ours.index[(ours.compared == 0) & (ours.finished > 0)]]
    without = ", ".join(map(str, ours.index[ours.finished == 0]))
    whose = "all the others" if without else "all of them"
    shared = f"Means over {int(ours.compared.max())} of {int(ours.planned.max())} runs, which {whose} have"
    share = "shares" if len(apart) == 1 else "share"
    shared += f", but {', '.join(apart)}, which {share} fewer than half." if apart else "."
    return f"\n\n{shared}" + (f" Without a finished run: {without}." if without else "")


def _paper_cells(row: Mapping[Any, Any]) -> tuple[str, ...]:
    cells = (*paper_scores(row), f"{row['lpips']:.3f}")
    return tuple(Markup(f"<u>{cell}</u>") for cell in cells) if row["failed"] else cells


def _number(value: float) -> str:
    return "" if pd.isna(value) else f"{value:.0f}"


def scene_text(table: pd.DataFrame, scene: str, profile: str, track: str) -> str:
    """One scene's table under its name, to be printed."""
    text = "\n".join(to_markdown(found, scene) for found in scene_tables(table, scene, profile, track))
    note = f"\n{NOTE}\n" if "(paper)" in text else ""
    return f"{_titled(scene, profile, track)}\n\n{text}{note}"


def _titled(scene: str, profile: str, track: str) -> str:
    suite = f", {suite_of(scene)} suite" if suite_of(scene) else ""
    return f"{scene} ({profile}, {track}{suite})"


def legend() -> str:
    """Which numbers of the tables should be high and which low, and what marks mean."""
    ways = {True: "higher", False: "lower"}
    titles = {way: [m.title for m in find_metrics() if m.higher_is_better == way] for way in ways}
    better = "; ".join(f"{', '.join(titles[way])}: {word} is better" for way, word in ways.items() if titles[way])
    return (
        f"{better}. Bold: best. Underlined: the method lacks runs, and is not ranked above a method that finished more."
    )


def grades_text(means: pd.DataFrame) -> str:
    """PSNR by severity grade, an effect below the other; empty where nothing is graded."""
    metric = find_metrics()[0]
    parts = []
    for effect, block in means.groupby("effect"):
        cells = [_grade_cells(block[block.grade == grade], metric) for grade in GRADES]
        body = [[method, *(column.get(method, "") for column in cells)] for method in sorted(set(block.index))]
        parts.append(markdown_table((str(effect), *(f"{grade}: {metric.title} (runs)" for grade in GRADES)), body))
    return "\n\n".join(parts)


def _grade_cells(means: pd.DataFrame, metric: Metric) -> dict[Hashable, str]:
    rows, scores = means.to_dict("index"), score_cells(means, metric)
    return {method: Markup(f"{scores[method]} ({runs_cell(row)})".strip()) for method, row in rows.items()}


def costs_text(means: pd.DataFrame) -> str:
    """Costs beside quality; methods that learn from clean views too."""
    metric = find_metrics()[0]
    scores = score_cells(means, metric)
    body = [
        (str(method), scores[method], *(cost_text(row[name]) for name in COST_TITLES), row["device"], runs_cell(row))
        for method, row in means.to_dict("index").items()
    ]
    return markdown_table(("costs", metric.title, *COST_TITLES.values(), "device", "runs"), body) + basis(means)


def cost_text(value: float) -> str:
    """A cost as tables show it; empty where there is none."""
    return "" if pd.isna(value) else f"{value:,.0f}" if abs(value) >= 100 else f"{value:.1f}"


def ablation_text(means: pd.DataFrame) -> str:
    """The paper's ablation on our runs beside its own numbers; may be empty."""
    if means.empty:
        return ""
    metrics, paper = find_metrics()[:2], published_ablation().to_dict("index")
    scores = [score_cells(means, metric) for metric in metrics]
    body = [
        (
            paper[method]["paper_method"],
            method,
            *(cells[method] for cells in scores),
            runs_cell(row),
            *paper_scores(paper[method]),
        )
        for method, row in means.to_dict("index").items()
    ]
    head = ("ablation", "method", *(metric.title for metric in metrics), "runs", *PAPER[:2])
    return markdown_table(head, body, keep_empty=True) + basis(means)


def paper_scores(row: Mapping[Any, Any]) -> tuple[str, str]:
    """The PSNR and SSIM that the paper published, as it prints them."""
    return f"{row['psnr']:.2f}", f"{row['ssim']:.3f}"


def suite_title(profile: str, track: str, suite: str) -> str:
    """What stands above a suite's tables; empty is the scenes of no suite."""
    return f"{f'Suite {suite}' if suite else 'Other scenes'}, {profile}, {track}"


def block_title(title: str, block: Block) -> str:
    """What stands above a comparison: the title, and below it what a second block is of."""
    return f"{title}\n\n{SHARED} ({block.shared_runs})" if block.shared_runs else title


def _suite_text(title: str, found: SuiteTables) -> str:
    texts = [grades_text(found.grades), costs_text(found.costs), ablation_text(found.ablation)]
    return "\n\n".join([title, *(text for text in texts if text)]) + "\n"


def all_text(tables: Tables) -> str:
    """Everything there is: every scene of every profile, a table a track; then grades, costs and ablation by suite."""
    parts = []
    for keys, found in tables.scenes.items():
        parts.append(f"## {_titled(*keys)}\n\n{to_markdown(found, keys[0])}")
        if keys in tables.shared_scenes:
            parts.append(to_markdown(tables.shared_scenes[keys], keys[0]))
    for keys, suite_tables in tables.suites.items():
        profile, track, suite = keys
        title = f"## {f'suite {suite}' if suite else 'other scenes'} ({profile}, {track})"
        parts.append(_suite_text(title, suite_tables))
        if keys in tables.shared_suites:
            parts.append(_suite_text(f"### {SHARED}", tables.shared_suites[keys]))
    text = "\n".join([*parts, legend() + "\n"])
    return text + (f"\n{NOTE}\n" if "(paper)" in text else "")
