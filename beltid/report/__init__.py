"""Summaries to terminal tables; no science."""
