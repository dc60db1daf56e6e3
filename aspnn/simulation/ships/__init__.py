"""Ship models: coefficients read from a vessel file, and compiled accelerations under a load.

Depends on vessel, schema and guidance (the columns of a state); the boats also on environment.waves (what waves press on).
"""
