"""Statistics that every identification needs, each once.

============= =============================================================
Module        Responsibility
============= =============================================================
signal        noise, spikes, converters and periodic lines of a signal
statistics    robust scale, correlation time, outliers, settings
least_squares linear and nonlinear least squares by library calls
============= =============================================================
"""
