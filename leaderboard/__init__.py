"""The evaluation harness: runs methods on built variants, scores what they render, tabulates."""
