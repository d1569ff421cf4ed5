"""A run from prepared charge to sealed file: frames, checkpoints, verdict."""
