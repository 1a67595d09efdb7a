"""Families of hard cases, one file each: `CASES`."""
