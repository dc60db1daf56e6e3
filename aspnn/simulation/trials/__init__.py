"""Manoeuvring trials, their indices and the criteria of IMO MSC.137(76).

Depends on ship, voyage, guidance and vessel.
"""
