"""Masks as programs name them, found for photographs, and how much of them they hide."""
