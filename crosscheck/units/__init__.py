"""Kinds of units of a night, one file each."""
