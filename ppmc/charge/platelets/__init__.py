"""Platelets placed at random, and the statistics of the result."""
