"""Evaluation: predictors on the same windows, measured against the truth (or the smoothed path), and the report."""
