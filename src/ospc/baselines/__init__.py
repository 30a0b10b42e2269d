"""Rival methods, each from its publication, to compare with under the same conditions.

None of them uses what this project's own estimators do, except the values they share: responses, vignettes, frames.
"""
