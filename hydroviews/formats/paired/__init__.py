"""Captures taken twice, in rain and clean."""
