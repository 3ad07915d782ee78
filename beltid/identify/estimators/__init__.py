"""Statistics and signal tools shared by all identifications.

============= =============================================================
Module        Responsibility
============= =============================================================
signal        noise, spikes, ADC steps and periodic lines of a signal
statistics    robust scale, correlation time, outliers, settings
============= =============================================================
"""
