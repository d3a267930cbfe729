"""Occlusion masks: what of each photograph is not the scene."""
