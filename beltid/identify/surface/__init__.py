"""From reduced runs to the friction surface mu(f_N, v)."""
