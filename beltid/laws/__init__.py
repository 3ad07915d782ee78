"""Constitutive formulas: pure, vectorised, one function per equation with its citation."""
