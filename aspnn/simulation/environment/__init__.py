"""Current, wind and waves: fields drawn at random, and what they do to a hull.

Depends on vessel and ships.coefficients.
"""
