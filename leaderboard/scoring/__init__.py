"""The second half of a run: what was rendered against the clean views, from files alone.

    score.py        all metrics of all views, and the record
    previews.py     one picture a run: input, render, truth, error
    submission.py   renders that somebody else made

Read `score.py` first.
"""
