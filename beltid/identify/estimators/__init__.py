"""Statistics and signal tools shared by all identifications.

============= =============================================================
Module        Responsibility
============= =============================================================
signal        noise, spikes, ADC steps and periodic lines of a signal
statistics    robust scale, correlation time, outliers, settings
least_squares linear and nonlinear least squares with numpy and scipy
============= =============================================================
"""
