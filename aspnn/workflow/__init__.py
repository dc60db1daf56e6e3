"""The compositions: simulate, filter, cut windows, train, evaluate. What the command line and the thin scripts call."""

from aspnn.workflow.filtering import consistency_files, filter_files, mount_file, states_for, tune_files, with_noise
from aspnn.workflow.judging import calibrate_files, choose_files, evaluate_files, training_curves
from aspnn.workflow.predicting import export_file, parse_plan, predict_file
from aspnn.workflow.recording import describe, import_files
from aspnn.workflow.shared import Watch, silent
from aspnn.workflow.simulating import estimate_vessel, simulate_files, trial_files
from aspnn.workflow.tracking import track_file
from aspnn.workflow.training import flow_by, search_file, train, training_logs, window_files

__all__ = [
    "Watch",
    "calibrate_files",
    "choose_files",
    "consistency_files",
    "describe",
    "estimate_vessel",
    "evaluate_files",
    "export_file",
    "filter_files",
    "flow_by",
    "import_files",
    "mount_file",
    "parse_plan",
    "predict_file",
    "search_file",
    "silent",
    "simulate_files",
    "states_for",
    "track_file",
    "train",
    "training_curves",
    "training_logs",
    "trial_files",
    "tune_files",
    "window_files",
    "with_noise",
]
