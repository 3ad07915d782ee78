"""Compression press: from a recording to the normal contact law, Eqs. (1) to (4)."""
