"""Estimation: from a log's sensor records to navigation states, filtered for inputs and smoothed for labels."""

from aspnn.estimation.cascade import filter_log, smooth_log

__all__ = ["filter_log", "smooth_log"]
