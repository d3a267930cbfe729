"""Vectors of several numbers, as processors calculate with them: arithmetic, loads and stores."""
