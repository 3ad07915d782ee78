"""Measured against simulated friction coefficients."""
