"""Engines side by side with certified truth: trajectories, adapters, comparison, commands."""
