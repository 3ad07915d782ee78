"""From reduced runs to the friction surface mu(f_N, v), and laws fitted to it (section 2.2)."""
