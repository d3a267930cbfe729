"""Learned features and their matches, which withstand rain: XFeat and LighterGlue, in torch."""
