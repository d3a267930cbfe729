"""Rainy and clean pairs of single photographs, for networks to learn from."""
