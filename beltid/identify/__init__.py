"""Measurement to parameters: arrays in, frozen results out. No files, no frames."""
