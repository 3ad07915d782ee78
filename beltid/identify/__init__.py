"""Identification: from recordings to contact parameters, a package per question."""
