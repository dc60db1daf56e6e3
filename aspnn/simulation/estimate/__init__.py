"""A vessel file from main dimensions: regressions, propeller series, resistance, and how sure their result is.

Depends on ships, ship, voyage and trials.indices.
"""
