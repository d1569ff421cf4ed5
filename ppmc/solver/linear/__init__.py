"""The linear system of a step and how it is solved."""
