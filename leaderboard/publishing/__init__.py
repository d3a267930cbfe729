"""Results for others: the board that ships, and files for other tools.

    publish.py         runs copied onto the board
    board_pages.py     its tables, comparisons and pages
    board_tables.py    tables on pages of Markdown, filled from it
    nerfbaselines.py   a run's scores as results.json of nerfbaselines

`publish.py` alone writes to the board.
"""
