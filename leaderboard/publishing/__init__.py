"""Results for others: the board that ships.

    publish.py         runs copied onto the board
    board_pages.py     its tables, comparisons and pages
    board_tables.py    tables on pages of Markdown, filled from it

`publish.py` alone writes to the board.
"""
