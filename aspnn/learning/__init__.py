"""From states to a trained network: windows, scaling, networks, training, checkpoints. Depends on records and motion."""
