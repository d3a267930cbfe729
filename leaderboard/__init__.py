"""The evaluation harness: runs methods on built variants, scores what they render, tabulates.

    evaluate.py    the whole benchmark in one call; read it first
    records.py     the one schema of a result
    tables/        records as tables, comparisons of methods, intervals, the paper's own numbers
    gather.py      all records of a results folder as one table
    runs/          one run: its settings, its training in a process of its own, its renders
    scoring/       renders against clean views; scored again; somebody else's renders
    site/          the leaderboard as pages
    publishing/    the board that ships, and results for other tools
    board/         the published runs
    sweep/         many runs in one call
    contract/      whether a method keeps its promises
    viewer/        a trained scene in a browser, films, files for other viewers

From `records.py` down, each imports what is above it, and `sweep` calls `evaluate`.
"""
