"""Records as tables.

    means.py           means over the runs that all compared methods have
    dataframes.py      tables as data frames: scenes, grades, costs, ablations
    markdown.py        written as Markdown
    latex.py           written as LaTeX
    table_files.py     the files they are in
    comparison.py      method against method
    statistics.py      how sure that is
    rain_losses.py     what plain splatting loses to a scene's rain, for its data card
    paper_numbers.py   the numbers that the paper published: published.csv

Read `dataframes.py` first.
"""
