"""Definitions of all columns that are read or written, their units and values. No file access."""
