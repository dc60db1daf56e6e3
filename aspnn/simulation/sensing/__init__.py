"""Sensors: what the instruments of a simulated ship record, with their errors, delays and resolutions.

Depends on voyage, frames, vessel and schema.
"""
