"""Gaussians whose colours differ from view to view."""
